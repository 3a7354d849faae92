from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.devices.settings import DeviceSettings
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.document import Captures
from tests.helpers.sphere_world import SphereSpecimen

pytest.importorskip("rona_core.virtual.robot.robot", reason="there is no virtual robot")
pytest.importorskip("rona_core.path.path_samples", reason="there is no path filter")
from rona_core.app.declarations.figures import FIGURES
from rona_core.evaluation.metrics import evaluate
from rona_core.evaluation.scan_metrics import detection_figures, true_probe_poses, wrong_inner
from rona_core.evaluation.truth import Truth
from rona_core.virtual.rig import build_scene
from rona_core.virtual.world.world import NOMINAL

SETTINGS = DeviceSettings()
STEPS = (
    "tool",
    "pointer",
    "surface",
    "registration",
    "path",
    "smoothing",
    "roll",
    "detection",
    "maps",
    "sono",
    "sono_maps",
)


@pytest.fixture(scope="module")
def scene():
    return build_scene(2, SphereSpecimen(), SETTINGS, NOMINAL)


def session_of(**results):
    filled = {step: None for step in STEPS} | {
        step: SimpleNamespace(value=value, arguments={}) for step, value in results.items()
    }
    return SimpleNamespace(
        setup=SimpleNamespace(devices=SETTINGS),
        results=SimpleNamespace(**filled, get=lambda name: None),
        captures=Captures(),
    )


def perfect_tool(scene):
    return SimpleNamespace(
        T_toolmarker_tip=scene.T_tip_toolmarker.inv(),
        T_base_tracker=scene.T_base_tracker,
        tip_sigma_mm=0.1,
        registration_sigma_mm=0.2,
    )


def test_a_new_session_has_every_key_and_no_figure(scene):
    figures = evaluate(session_of(), scene)
    assert tuple(figures) == tuple(FIGURES)
    assert figures["completed"] is False
    assert figures["failed_step"] == "tool"
    others = [v for k, v in figures.items() if k not in ("completed", "failed_step", "reason")]
    assert others == [None] * (len(FIGURES) - 3)


def test_results_are_scored_as_they_come(scene):
    figures = evaluate(session_of(tool=perfect_tool(scene)), scene)
    assert figures["tool_tip_error_mm"] == pytest.approx(0.0, abs=1e-9)
    assert figures["tracker_registration_tre_mm"] == pytest.approx(0.0, abs=1e-9)
    assert figures["failed_step"] == "pointer"
    assert figures["pointer_tip_error_mm"] is None


def test_the_scene_follows_the_settings_of_the_session(scene):
    moved = DeviceSettings(robot=type(SETTINGS.robot)(base_shift_mm=(50.0, 0.0, 0.0)))
    session = session_of(tool=perfect_tool(scene))
    session.setup.devices = moved
    figures = evaluate(session, scene)
    assert figures["tracker_registration_tre_mm"] == pytest.approx(50.0, abs=1e-6)


def test_a_path_that_no_roll_can_follow_says_so(scene):
    verdicts = (SimpleNamespace(feasible=False),) * 72
    search = SimpleNamespace(verdicts=verdicts, mode="none")
    plan = SimpleNamespace(search=search, trajectory=None, certificate=None)
    figures = evaluate(session_of(roll=plan), scene)
    assert (figures["rolls_tried"], figures["rolls_feasible"]) == (72, 0)
    assert figures["roll_mode"] == "none"
    assert figures["failed_step"] == "roll"
    assert "base" in figures["reason"]


def scan_over(scene, n=40):
    """A scan capture with the probe anywhere, and a detection that is exact along its axis."""
    rng = np.random.default_rng(0)
    qs = np.deg2rad((15.0, 10.0, 100.0, 0.0, 70.0, 30.0)) + rng.normal(0, 0.01, (n, 6))
    times = np.arange(n) * 0.05
    joints = SimpleNamespace(at=lambda t: qs[np.round(t / 0.05).astype(int)])
    return SimpleNamespace(ordinal=9, joints=joints, scans=SimpleNamespace(times_s=times))


def test_the_true_probe_is_where_the_robot_errs_to(scene):
    scan = scan_over(scene)
    true = true_probe_poses(scan, Truth(scene))
    exact = DeviceSettings(robot=type(SETTINGS.robot)(errors=False))
    still = build_scene(2, SphereSpecimen(), exact, NOMINAL)
    nominal = true_probe_poses(scan, Truth(still))
    off = true.translations - nominal.translations
    systematic = scene.robot_error.systematic_mm(nominal.translations)
    assert np.linalg.norm(off - systematic, axis=1).max() < 0.15
    assert np.linalg.norm(off, axis=1).max() > 0.05


def facing_region(scene, gaps_mm):
    """Probe poses above the middle of the region, looking along the normal."""
    center, normal, _ = scene.region_base()
    x = np.cross(normal, (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    rotation = np.column_stack((x, np.cross(-normal, x), -normal))
    return Poses.stack([Pose(rotation, center + gap * normal) for gap in gaps_mm])


def test_the_bone_is_as_thick_below_a_probe_that_hovers_or_presses(scene):
    below = Truth(scene).thickness_below_mm(facing_region(scene, (0.0, 1.5, -1.5)))
    np.testing.assert_allclose(below, (6.0, 6.0, 6.0), atol=1e-9)


def test_only_errors_over_half_a_millimetre_are_failures():
    true = np.array([6.0, 6.0, 6.0, np.inf, np.inf])
    detection = SimpleNamespace(
        thickness_mm=np.array([6.4, 6.6, 0.0, 6.0, 0.0]),
        flag=np.array([0, 0, 2, 0, 2]),
    )
    np.testing.assert_array_equal(wrong_inner(detection, true), (False, True, True, True, False))


def test_shares_of_failures_count_flagged_scans_too(scene, monkeypatch):
    poses = facing_region(scene, np.zeros(10))
    monkeypatch.setattr(
        "rona_core.evaluation.scan_metrics.true_probe_poses", lambda scan, truth: poses
    )
    flag = np.array([0, 0, 0, 0, 0, 0, 2, 2, 1, 6])
    thickness = np.array([6.0, 6.4, 5.6, 6.0, 8.0, 6.0, 0.0, 6.0, 0.0, 9.0])
    detection = SimpleNamespace(flag=flag, thickness_mm=thickness)
    assert detection_figures([(detection, (None,))], Truth(scene)) == {
        "detection_failure_fraction": pytest.approx(0.4),
        "unflagged_failure_fraction": pytest.approx(1 / 6),
        "flagged_fraction": pytest.approx(0.4),
    }


def test_no_scans_have_no_shares(scene):
    empty = np.zeros(0)
    detection = SimpleNamespace(flag=empty, thickness_mm=empty)
    figures = detection_figures([(detection, (None,))], Truth(scene))
    assert list(figures.values()) == [None, None, None]
