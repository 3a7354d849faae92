"""The true tip behind a measured one is found whatever the tracker did to the frame."""

import numpy as np
import pytest

from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import DeviceSettings, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.evaluation.navigation_metrics import true_tips_base
from rona_core.geometry.pose import Pose
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.operator.operator import VirtualOperator
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.tracker import VirtualTracker
from tests.helpers.sphere_world import ScriptedWorld, ShiftError, SphereSpecimen

ORDINAL = 6


def recorded(pointer, clear=None, **faults):
    """A track of a pointer, the scene, and the true tips when its frames were measured."""
    settings = DeviceSettings(pointer=pointer, tracker=TrackerSettings(**faults))
    scene = VirtualScene(
        4,
        SphereSpecimen(),
        settings,
        robot_error=ShiftError(),
        T_tip_toolmarker=Pose.identity(),
    )
    operator = VirtualOperator(scene)
    operator.begin(scene, settings, ORDINAL)
    operator.draw(spacing_mm=6.0, duration_s=2.0)
    motion, T_tracker_base = operator.motion(), scene.T_base_tracker.inv()

    def true_pose(tool, time_s):
        at = T_tracker_base @ motion.Ts_base_pointermarker(np.array([time_s]))[0]
        return at if tool == motion.pointer else None

    tracker = VirtualTracker(CaptureClock(), ScriptedWorld(true_pose, clear), scene.seed)
    tracker.begin(settings.tracker, ORDINAL)
    track = ToolTrack.from_frames(pointer, [tracker.frame(k) for k in range(0, 120, 5)])
    tips = motion.tip_base(track.times_s - settings.tracker.latency_s)
    return scene, track, tips


def one_hidden(tool, pose, time_s):
    """Another marker is hidden every tenth of a second."""
    clear = np.ones(len(GEOMETRIES[tool].positions_marker), dtype=bool)
    clear[int(max(time_s, 0.0) * 10) % len(clear)] = False
    return clear


@pytest.mark.sweep(3)
@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
@pytest.mark.parametrize(
    "faults",
    [
        {"profile": "spectra"},
        {"profile": "vega"},
        {"stereo": False},
        {"depth_ratio": 6.0},
        {"latency_ms": 80.0},
        {"drift_mm": 1.0, "minutes_on": 0.0},
        {"phantom_share": 0.2},
        {"profile": "white035", "phantom_share": 0.2, "latency_ms": 40.0, "drift_mm": 0.5},
    ],
)
def test_the_true_tip_is_found_behind_every_fault(pointer, faults):
    scene, track, tips = recorded(pointer, **faults)
    rows = np.arange(len(tips))
    found = true_tips_base(scene, track, ORDINAL, rows)
    np.testing.assert_allclose(found, tips, atol=1e-6)


@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
def test_which_markers_were_hidden_follows_from_the_error_of_the_fit(pointer):
    scene, track, tips = recorded(pointer, clear=one_hidden)
    _, whole, _ = recorded(pointer)
    assert (track.rms_error_mm != whole.rms_error_mm).all()
    found = true_tips_base(scene, track, ORDINAL, np.arange(len(tips)))
    np.testing.assert_allclose(found, tips, atol=1e-6)
