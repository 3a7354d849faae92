"""Strokes of step 4 with the pointer lifted between them: each is a recording of its own."""

import numpy as np
import pytest

from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.compose import new_workbench
from rona_core.errors import InvalidInputError
from tests.scenes.demo_parts import registered

APART_MM = 24.0


@pytest.fixture
def bench():
    bench = new_workbench(registered())
    yield bench
    bench.close()


def lines(bench, count):
    """Return picks of short parallel lines on the skull, and where each but the first begins."""
    center, normal, _ = bench.rig().display.region()
    across = np.cross(normal, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    offsets = APART_MM * (np.arange(count) - (count - 1) / 2.0)
    places = [center + o * across + a * along for o in offsets for a in (-8.0, 0.0, 8.0)]
    return tuple(tuple(map(float, place)) for place in places), tuple(range(3, 3 * count, 3))


def test_each_stroke_is_recorded_and_nothing_is_sampled_between_them(bench):
    picks, lifts = lines(bench, 3)
    bench.run(StartSurfaceCapture(12.0, picks, lifts=lifts))
    strokes, cloud = bench.session.captures.surface, bench.session.results.surface.value
    assert [stroke.ordinal for stroke in strokes] == sorted({s.ordinal for s in strokes})
    assert len(strokes) == 3
    assert all(3.5 < stroke.marker.times_s[-1] < 4.5 for stroke in strokes)
    assert len(np.unique(cloud.strokes)) == 3
    for number, rows in enumerate(np.reshape(picks, (3, 3, 3))):
        tips = cloud.points_base[cloud.strokes == number]
        away = np.abs((tips - rows[1]) @ ((rows[2] - rows[0]) / 16.0))
        assert away.max() < 11.0
        assert np.linalg.norm(tips - rows[1], axis=1).max() < 0.5 * APART_MM
    for left in (3, 2, 1, 0):  # the cloud is taken back first, then stroke by stroke
        bench.dispatch(Undo())
        assert bench.session.captures.surface == strokes[:left]
    assert len(bench.session.archive) == 3 + len(registered().archive)


def test_one_that_is_stopped_keeps_those_before_it(bench):
    picks, lifts = lines(bench, 2)
    shares = []

    def stop_in_the_second():
        return bool(shares) and shares[-1] > 0.6

    bench.run(
        StartSurfaceCapture(8.0, picks, lifts=lifts),
        progress=shares.append,
        cancel=stop_in_the_second,
    )
    (whole,) = bench.session.captures.surface
    assert [taken.partial for taken in bench.session.archive[-2:]] == [False, True]
    assert whole is bench.session.archive[-2]
    assert shares == sorted(shares)
    assert bench.session.results.surface is None


@pytest.mark.parametrize("lifts", [(0,), (2, 1), (1, 1), (3,)])
def test_lifts_that_are_no_picks_are_refused_with_what_they_may_be(lifts):
    picks = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    with pytest.raises(
        InvalidInputError, match=r"lifts must (increase from 1 to 2|be 1 to 500, not 0)"
    ):
        StartSurfaceCapture(picks_base_mm=picks, lifts=lifts)


def test_without_picks_nothing_is_lifted():
    with pytest.raises(InvalidInputError, match="without picks"):
        StartSurfaceCapture(lifts=(1,))
