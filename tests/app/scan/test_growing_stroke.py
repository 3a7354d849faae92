"""The tip of the pointer while it slides, and that watching it changes no bit of the capture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.references import REGISTERED
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.surface.derivation import tip_track
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.surface.step import StrokeGrower, record_strokes
from rona_core.compose import build_virtual_rig
from rona_core.devices.live import Live
from rona_core.session.codec import digest

DURATION_S = 4.0


class Watched(Live):
    """Live slots that somebody grows a stroke from whenever frames have come."""

    def __init__(self, session):
        super().__init__()
        self.grower, self.grown, self.frames = StrokeGrower(session), [], ()

    def put(self, **parts):
        super().put(**parts)
        if parts.get("frames"):
            self.frames = parts["frames"]
            self.grown.append(self.grower.grown(self.frames))


@pytest.fixture(scope="module")
def rig(demo):
    return build_virtual_rig(demo.setup)


def swept(demo, rig, live):
    context = ActivityContext(
        devices=lambda: rig, live=live, import_skull=lambda *_, **__: None, uploads=Path()
    )
    stored, _ = record_strokes(StartSurfaceCapture(duration_s=DURATION_S), demo, context)
    return stored.capture


@pytest.fixture(scope="module")
def watched(demo, rig):
    live = Watched(demo)
    return live, swept(demo, rig, live)


def test_watching_changes_no_bit_of_the_capture_and_keeps_nothing(demo, rig, watched):
    live, seen = watched
    assert digest(swept(demo, rig, Live())) == digest(seen)
    assert live.get().frames == ()


def test_it_grows_to_the_tips_that_the_capture_has(demo, watched):
    live, seen = watched
    lengths = [len(tips) for tips in live.grown]
    assert len(lengths) > 10
    assert np.all(np.diff(lengths) > 0)
    still = replace(seen, head=None)  # what grows does not know how the head has moved
    pointer = required(POINTER, demo)
    tips = tip_track(still, required(REGISTERED, demo), pointer, None)
    np.testing.assert_allclose(live.grown[-1], tips[: lengths[-1]], atol=1e-9)
    assert lengths[-1] > 0.9 * len(tips)


def test_each_frame_is_looked_at_once(demo, watched):
    live, _ = watched
    grower = StrokeGrower(demo)
    first = grower.grown(live.frames[:60])
    assert grower.grown(live.frames[:60]) is first
    np.testing.assert_array_equal(grower.grown(live.frames)[: len(first)], first)


def test_without_a_calibrated_pointer_nothing_is_shown(demo, watched):
    live, _ = watched
    blank = replace(demo, results=replace(demo.results, pointer=None))
    assert StrokeGrower(blank).grown(live.frames).shape == (0, 3)
