from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.evaluation.truth import Truth, rms
from rona_core.path.manual_edits import PathEdits
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.session.codec import digest
from tests.core.evaluation.test_navigation_metrics import truth_of

pytest.importorskip("rona_core.path.path_samples", reason="there is no path filter")
from rona_core.evaluation.navigation_metrics import (
    deviation_max_mm,
    filter_width_s,
    normal_figures,
    plan_figures,
    smoothing_figures,
    to_segment_mm,
)

seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=25)
@given(seeds)
def test_the_distance_to_a_segment_is_the_least_over_its_points(seed):
    rng = np.random.default_rng(seed)
    points, start, end = rng.normal(size=(8, 3)), rng.normal(size=3), rng.normal(size=3)
    dense = start + np.linspace(0, 1, 4001)[:, None] * (end - start)
    brute = np.linalg.norm(points[:, None] - dense[None], axis=2).min(axis=1)
    np.testing.assert_allclose(to_segment_mm(points, start, end), brute, atol=2e-3)


def test_beyond_its_ends_a_segment_is_as_far_as_its_end():
    start, end = np.zeros(3), np.array((10.0, 0.0, 0.0))
    points = np.array([(13.0, 4.0, 0.0), (-3.0, 0.0, 4.0), (5.0, 2.0, 0.0)])
    np.testing.assert_allclose(to_segment_mm(points, start, end), (5.0, 5.0, 2.0))
    np.testing.assert_allclose(to_segment_mm(points[2:], start, start), np.sqrt(29.0))


def test_k1_is_the_height_of_the_bump_that_was_cut_off():
    points = np.array([(0, 0, 0), (1, 0.4, 0), (2, 0, 0), (3, -0.7, 0), (4, 0, 0.0)])
    kept = np.array([0, 2, 4])
    assert deviation_max_mm(points, kept, points[kept]) == pytest.approx(0.7)
    assert deviation_max_mm(points, np.array([0, 3, 4]), points[[0, 3, 4]]) > 0.5
    everything = np.arange(5)
    assert deviation_max_mm(points, everything, points) == 0.0


def session_of(samples, kept, filter_s, n_original=None):
    times = np.arange(len(samples)) / 60.0
    simplified = SimpleNamespace(index=kept, n_original=n_original or len(samples))
    smoothing = SimpleNamespace(
        value=SimpleNamespace(simplified=simplified),
        arguments={"filter_s": filter_s},
        inputs={"edits": digest(PathEdits())},
    )
    return SimpleNamespace(
        results=SimpleNamespace(
            smoothing=smoothing,
            path=SimpleNamespace(value=SimpleNamespace(points_base=samples), message="BuildPath"),
        ),
        path_edits=PathEdits(),
        captures=SimpleNamespace(path=SimpleNamespace(marker=SimpleNamespace(times_s=times))),
    )


def test_without_a_filter_both_deviations_are_the_same():
    samples = np.column_stack((np.arange(50.0), np.sin(np.arange(50.0)), np.zeros(50)))
    figures = smoothing_figures(session_of(samples, np.array([0, 20, 49]), 0.0))
    assert figures["path_points_smoothed"] == 3
    assert figures["path_deviation_max_mm"] == figures["path_deviation_raw_max_mm"]
    assert 0.9 < figures["path_deviation_max_mm"] <= 2.0


def test_a_filter_that_removes_a_tremor_shows_in_the_raw_deviation_only():
    x = np.arange(240.0) / 4
    samples = np.column_stack((x, 0.3 * np.sin(2 * np.pi * 10 * np.arange(240) / 60), 0 * x))
    figures = smoothing_figures(session_of(samples, np.array([0, 239]), 0.1))
    assert figures["path_deviation_max_mm"] < 0.1
    assert 0.2 < figures["path_deviation_raw_max_mm"] < 0.4


def test_a_path_that_was_demonstrated_again_is_not_compared():
    samples = np.zeros((10, 3)) + np.arange(10.0)[:, None]
    figures = smoothing_figures(session_of(samples, np.array([0, 9]), 0.0, n_original=12))
    assert figures == {"path_points_smoothed": 2}


def test_the_width_of_the_filter_comes_from_what_was_asked_for():
    assert filter_width_s({"filter_s": 0.05}) == 0.05
    assert filter_width_s({}) == 0.0


@settings(max_examples=10)
@given(seeds, st.floats(0.0, 30.0))
def test_axes_that_lean_by_an_angle_are_off_by_that_angle(seed, angle_deg):
    truth = truth_of(seed)
    rng = np.random.default_rng(seed)
    points = truth.region_points(5.0)
    _, normals = truth.foot(points)
    across = np.cross(normals, rng.normal(size=3))
    across /= np.linalg.norm(across, axis=1)[:, None]
    angle = np.deg2rad(angle_deg)
    path = SimpleNamespace(
        points_base=points, axes_base=-np.cos(angle) * normals + np.sin(angle) * across
    )
    figures = normal_figures(path, truth)
    assert figures["normal_error_median_deg"] == pytest.approx(angle_deg, abs=1e-6)
    assert figures["normal_error_p95_deg"] == pytest.approx(angle_deg, abs=1e-6)


def test_waves_smaller_than_a_face_turn_the_normal_at_a_point_and_not_below_a_face():
    truth = truth_of(0)
    points, height_mm, wave_mm = truth.region_points(5.0), 0.05, 3.0
    smooth = truth.foot

    def rough(at):
        feet, normals = smooth(at)
        phase = 2.0 * np.pi * feet[:, :1] / wave_mm
        along = np.eye(3)[0] - normals[:, :1] * normals
        slopes = 2.0 * np.pi * height_mm / wave_mm * np.cos(phase)
        turned = normals - slopes * along
        turned /= np.linalg.norm(turned, axis=1)[:, None]
        return feet + height_mm * np.sin(phase) * normals, turned

    truth.foot = rough
    at_points = rough(points)[1]
    for found, below, above in ((truth.face_normals(points, 5.0), 0.0, 0.5), (at_points, 3.0, 5.0)):
        cosine = np.clip((found * smooth(points)[1]).sum(axis=1), -1.0, 1.0)
        assert below <= np.rad2deg(np.sqrt(np.mean(np.arccos(cosine) ** 2))) < above
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)


def test_normals_that_point_into_the_bone_are_half_a_turn_off():
    truth = truth_of(1)
    points = truth.region_points(10.0)
    _, normals = truth.foot(points)
    path = SimpleNamespace(points_base=points, axes_base=normals)
    assert normal_figures(path, truth)["normal_error_median_deg"] == pytest.approx(180.0)


def test_a_plan_is_counted_by_rolls_and_timed_from_end_to_end():
    verdicts = tuple(SimpleNamespace(feasible=i % 3 == 0) for i in range(72))
    # on the path joint 5 of the RX90 comes within 7.5 degrees of its upper limit, 120 degrees
    joint_5_deg = (119.0, 45.0, 112.5, 60.0, 119.0)
    qs_rad = np.deg2rad([[0, 0, 90, 0, angle, 0] for angle in joint_5_deg])
    times_s = np.array([0.0, 1.5, 20.0, 55.0, 61.25])
    trajectory = Trajectory(times_s, qs_rad, 1.5, 55.0, np.zeros(5))
    plan = SimpleNamespace(
        model="rx90",
        search=SimpleNamespace(verdicts=verdicts, mode="variable", roll_variation_deg=35.0),
        trajectory=trajectory,
        certificate=SimpleNamespace(min_clearance_mm=7.5),
    )
    assert plan_figures(plan) == {
        "rolls_tried": 72,
        "rolls_feasible": 24,
        "roll_mode": "variable",
        "roll_variation_deg": 35.0,
        "min_clearance_mm": 7.5,
        "min_joint_margin_deg": pytest.approx(7.5),
        "scan_duration_s": 61.25,
    }
    search = SimpleNamespace(verdicts=verdicts[1:3], mode="none")
    nothing = SimpleNamespace(search=search, trajectory=None, certificate=None)
    figures = plan_figures(nothing)
    assert figures["scan_duration_s"] is None
    assert figures["roll_variation_deg"] is None
    assert figures["min_joint_margin_deg"] is None
    assert figures["min_clearance_mm"] is None


class Rough:
    """A ball with waves 3 mm long and 0.05 mm high on it: slopes of 6 degrees at points."""

    def __init__(self, specimen):
        self._specimen = specimen

    def __getattr__(self, name):
        return getattr(self._specimen, name)

    def normal(self, points_skull):
        normals = self._specimen.normal(points_skull)
        slope = 0.1 * np.cos(2.0 * np.pi / 3.0 * np.asarray(points_skull)[:, :1])
        leant = normals + slope * np.cross(normals, (0.0, 1.0, 0.0))
        return leant / np.linalg.norm(leant, axis=1)[:, None]


def test_the_true_normal_is_that_below_the_face_of_the_probe():
    truth = truth_of(2)
    points = truth.region_points(6.0)
    smooth = truth.foot(points)[1]
    np.testing.assert_allclose(truth.face_normals(points, 5.0), smooth, atol=1e-6)
    truth.scene.specimen = Rough(truth.scene.specimen)
    rough = Truth(truth.scene)
    at_points, below = rough.foot(points)[1], rough.face_normals(points, 5.0)
    off = [np.linalg.norm(np.cross(found, smooth), axis=1) for found in (at_points, below)]
    assert rms(off[1]) < 0.4 * rms(off[0])


def test_the_feet_of_the_same_points_are_looked_for_once(monkeypatch):
    truth = truth_of(2)
    points = truth.region_points(6.0)
    asked, closest = [], type(truth.scene.specimen).closest

    def counted(self, points_skull):
        asked.append(len(points_skull))
        return closest(self, points_skull)

    monkeypatch.setattr(type(truth.scene.specimen), "closest", counted)
    first, again = truth.foot(points), truth.foot(points.copy())
    assert asked == [len(points)]
    np.testing.assert_array_equal(first, again)
    truth.foot(points[1:])
    assert asked == [len(points), len(points) - 1]
