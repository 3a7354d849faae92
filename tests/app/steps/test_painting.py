"""Painted regions in the session: patterns, strokes, smoothing and further passes keep to them."""

from pathlib import Path

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import handle
from rona_core.app.runtime.session_step import Undo
from rona_core.app.runtime.store import Store
from rona_core.app.steps.path.inputs import require_allowed_picks
from rona_core.app.steps.path.messages import (
    BuildPath,
    ClearPaintedRegions,
    GenerateScanPattern,
    PaintRegion,
    StartPathCapture,
)
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.setup.messages import SetPointer, SetRobot, SetSeed
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session, session_bytes
from tests.helpers.session_file import reopened

FILE = Path(__file__).parents[2] / "sessions" / "path.rona"


@pytest.fixture(scope="module")
def smoothed() -> Session:
    session = load_session(FILE)
    for command in (
        RegisterTool("paper"),
        CalibratePointer("sphere"),
        BuildSurface(),
        BuildPath(),
        SmoothScanPath(),
    ):
        session = handle(command, session)
    return session


def plain(place):
    x, y, z = (float(part) for part in place)
    return x, y, z


def middle(session):
    cloud = session.results.surface.value.points_base
    return cloud[np.linalg.norm(cloud - np.median(cloud, axis=0), axis=1).argmin()]


def near(session, offset_mm):
    """Return the place of the cloud nearest to an offset (3,) from its middle."""
    cloud = session.results.surface.value.points_base
    return plain(cloud[np.linalg.norm(cloud - middle(session) - offset_mm, axis=1).argmin()])


def post(session, kind="avoid", radius_mm=6.0):
    return handle(PaintRegion(kind, (plain(middle(session)),), radius_mm), session)


def path_base(session):
    return session.results.path.value.points_base


@pytest.mark.parametrize("kind", ["raster", "spiral"])
def test_a_pattern_and_its_smoothed_path_keep_off_what_is_avoided(smoothed, kind):
    painted = post(smoothed)
    made = handle(GenerateScanPattern(kind, spacing_mm=3.0), painted)
    assert painted.painted.depths_mm("avoid", path_base(made)).max() < -1.0
    smooth = handle(SmoothScanPath(), made).results.smoothing.value
    assert not painted.painted.avoided(smooth.path.points_base).any()
    free = handle(GenerateScanPattern(kind, spacing_mm=3.0), smoothed)
    assert painted.painted.avoided(path_base(free)).sum() > 5


def test_a_pattern_fills_what_is_painted_to_be_scanned_alone(smoothed):
    ends = near(smoothed, (-8.0, 0.0, 0.0)), near(smoothed, (8.0, 0.0, 0.0))
    painted = handle(PaintRegion("scan", ends, 5.0), smoothed)
    made = path_base(handle(GenerateScanPattern(spacing_mm=2.0), painted))
    depths = painted.painted.depths_mm("scan", made)
    assert depths.min() > -0.3  # the plane of the pattern is not quite that of the bone
    whole = path_base(handle(GenerateScanPattern(spacing_mm=2.0), smoothed))
    wanted = whole[painted.painted.depths_mm("scan", whole) > 0.0]
    assert np.linalg.norm(wanted[:, None] - made, axis=2).min(axis=1).max() < 2.5
    assert len(made) < 0.5 * len(whole)


def test_a_path_through_what_is_avoided_is_stale_and_cannot_be_smoothed(smoothed):
    painted = post(smoothed)
    assert "painting of regions" in stale_reason("smoothing", painted)
    with pytest.raises(InvalidInputError, match="mm into a region to avoid, first at"):
        handle(SmoothScanPath(), painted)
    cleared = handle(ClearPaintedRegions("scan"), painted)
    assert len(cleared.painted) == 1
    assert stale_reason("smoothing", handle(ClearPaintedRegions(), painted)) is None


def test_a_drawn_line_that_crosses_is_refused_by_its_points(smoothed):
    painted = post(smoothed)
    across = [near(smoothed, (x, 0.0, 0.0)) for x in (-20.0, -14.0, 14.0)]
    beside = [near(smoothed, (x, 15.0, 0.0)) for x in (-20.0, 14.0)]
    with pytest.raises(InvalidInputError, match="from point 2 to 3 crosses a region to avoid"):
        require_allowed_picks(StartPathCapture(picks_base_mm=tuple(across)), painted)
    require_allowed_picks(StartPathCapture(picks_base_mm=tuple(beside)), painted)
    require_allowed_picks(StartPathCapture(picks_base_mm=tuple(across)), smoothed)
    wanted = post(smoothed, "scan")
    with pytest.raises(InvalidInputError, match="leaves the region to scan"):
        require_allowed_picks(StartPathCapture(picks_base_mm=tuple(beside)), wanted)


def test_strokes_are_undone_one_by_one_and_kept_in_the_file(smoothed):
    store = Store(smoothed)
    store.dispatch(PaintRegion("avoid", (plain(middle(smoothed)),), 6.0))
    store.dispatch(PaintRegion("scan", (near(smoothed, (0.0, 9.0, 0.0)),), 3.0))
    again = reopened(store.session)
    assert digest(again.painted) == digest(store.session.painted)
    store.dispatch(Undo())
    assert [stroke.kind for stroke in store.session.painted.strokes] == ["avoid"]
    store.close()


def test_a_session_without_paint_is_stored_as_before(smoothed):
    assert b'"painted"' not in session_bytes(smoothed)
    assert len(reopened(smoothed).painted) == 0


def test_paint_goes_with_the_bone_it_is_on(smoothed):
    painted = post(smoothed)
    assert len(handle(SetPointer("pointer6d"), painted).painted) == 1
    for other in (SetSeed(5), SetRobot("ur10"), SetRobot(base_shift_mm=(10.0, 0.0, 0.0))):
        assert len(handle(other, painted).painted) == 0


def test_what_is_no_stroke_is_refused(smoothed):
    with pytest.raises(InvalidInputError, match="1 to 500 values"):
        PaintRegion("avoid", ())
    with pytest.raises(InvalidInputError, match="radius_mm"):
        PaintRegion("avoid", ((0.0, 0.0, 0.0),), 0.1)
    with pytest.raises(InvalidInputError, match="stroke_base_mm must be -100000 to 100000"):
        PaintRegion("avoid", ((np.nan, 0.0, 0.0),))
    with pytest.raises(InvalidInputError, match="off the measured surface"):
        handle(PaintRegion("avoid", ((0.0, 0.0, 0.0),)), smoothed)
    with pytest.raises(StepBlockedError, match="sample the surface"):
        handle(PaintRegion("avoid", ((0.0, 0.0, 0.0),)), Session())
