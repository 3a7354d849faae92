import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.settings import DeviceSettings, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.virtual.operator.hand_trajectories import (
    interpolating_curve,
    points_along,
    raster_curve,
)
from rona_core.virtual.operator.operator import PICK_REACH_MM, RIM_MM, VirtualOperator
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.tracker import observe
from tests.helpers.sphere_world import ShiftError, SphereSpecimen, signed_distance

seeds = st.integers(0, 2**32 - 1)


def operator_of(seed=0, pointer="pointer6d", ordinal=1, specimen=None):
    setup = DeviceSettings(pointer=pointer)
    scene = VirtualScene(
        seed,
        specimen or SphereSpecimen(),
        setup,
        robot_error=ShiftError(),
        T_tip_toolmarker=Pose.identity(),
    )
    operator = VirtualOperator(scene)
    operator.begin(scene, setup, ordinal)
    return scene, operator


def heights(scene, tips):
    return signed_distance(scene.specimen, scene.T_base_skull.inv() @ tips)


def in_region(scene, tips):
    """Coordinates in the tangent plane of the region (n, 2)-like distances from its axis."""
    center, normal, _ = scene.region_base()
    off = tips - center
    return np.linalg.norm(off - (off @ normal)[:, None] * normal, axis=1)


def prepare(operator, kind, scene):
    if kind == "pivot":
        return operator.pivot(cone_deg=25.0, duration_s=12.0)
    if kind == "sweep":
        return operator.sweep(duration_s=30.0)
    if kind == "draw":
        return operator.draw(spacing_mm=4.0, duration_s=20.0)
    center, _, _ = scene.region_base()
    return operator.stroke(center + np.array([(0, 0, 0), (12, 0, 0), (12, 9, 0)]), duration_s=5.0)


@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
@pytest.mark.parametrize("kind", ["pivot", "sweep", "draw", "stroke"])
def test_the_tip_of_the_marker_is_the_tip_that_touches(pointer, kind):
    scene, operator = operator_of(3, pointer)
    duration_s = prepare(operator, kind, scene)
    motion = operator.motion()
    assert motion.duration_s == duration_s
    for t in np.linspace(0.0, duration_s, 25):
        tip = motion.Ts_base_pointermarker(np.array([t]))[0] @ scene.tips[pointer]
        np.testing.assert_allclose(tip, motion.tip_base(t), atol=1e-9)


@pytest.mark.parametrize("kind", ["sweep", "draw", "stroke"])
def test_the_tip_slides_on_the_bone_and_never_leaves_it(kind):
    scene, operator = operator_of(1)
    duration_s = prepare(operator, kind, scene)
    tips = operator.motion().tip_base(np.arange(0.0, duration_s, 0.0037))  # between the samples
    assert np.abs(heights(scene, tips)).max() < 0.002


@pytest.mark.parametrize("kind", ["sweep", "draw", "stroke"])
def test_the_pointer_leans_at_most_twenty_degrees_and_slowly(kind):
    scene, operator = operator_of(2)
    duration_s = prepare(operator, kind, scene)
    times = np.arange(0.0, duration_s, 0.01)
    shafts, tips = operator.motion().shaft_base(times), operator.motion().tip_base(times)
    _, normal, _ = scene.region_base()
    outward = normal if kind != "stroke" else None
    if outward is None:
        skull = scene.T_base_skull
        outward = skull.rotate(scene.specimen.normal(skull.inv() @ tips))
        limit_deg = 20.5  # the hand aims by normals between the places
    else:
        limit_deg = 20.01
    lean = np.arccos(np.clip((shafts * outward).sum(axis=1), -1, 1))
    assert np.rad2deg(lean.max()) < limit_deg
    turn = np.arccos(np.clip((shafts[1:] * shafts[:-1]).sum(axis=1), -1, 1)) / 0.01
    assert np.rad2deg(turn.max()) < 45.0


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_a_drawn_path_stays_inside_the_region_and_covers_it(seed):
    scene, operator = operator_of(seed)
    duration_s = operator.draw(spacing_mm=4.0, duration_s=20.0)
    tips = operator.motion().tip_base(np.arange(0.0, duration_s, 0.01))
    _, _, radius_mm = scene.region_base()
    assert in_region(scene, tips).max() <= radius_mm
    assert uncovered(scene, tips, radius_mm, 3.5) < 0.01


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_a_sweep_covers_the_region_and_a_rim(seed):
    scene, operator = operator_of(seed)
    duration_s = operator.sweep(duration_s=30.0)
    tips = operator.motion().tip_base(np.arange(0.0, duration_s, 1 / 60))
    _, _, radius_mm = scene.region_base()
    assert in_region(scene, tips).max() <= radius_mm + RIM_MM + 3.0
    assert uncovered(scene, tips, radius_mm + RIM_MM - 2.0, 3.0) < 0.01


def uncovered(scene, tips, radius_mm, reach_mm):
    """Share of a disc about the region further than ``reach_mm`` from all tips, brute force."""
    center, normal, _ = scene.region_base()
    x = np.cross(normal, (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    axes = np.column_stack((x, np.cross(normal, x)))
    flat = (tips - center) @ axes
    u = np.arange(-radius_mm, radius_mm, 2.0)
    grid = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) <= radius_mm]
    nearest = np.linalg.norm(grid[:, None] - flat[None], axis=2).min(axis=1)
    return np.mean(nearest > reach_mm)


@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
@pytest.mark.parametrize("cone_deg", [10.0, 30.0])
def test_a_pivot_holds_the_tip_and_covers_its_cone(pointer, cone_deg):
    scene, operator = operator_of(5, pointer)
    duration_s = operator.pivot(cone_deg=cone_deg, duration_s=15.0)
    motion = operator.motion()
    times = np.arange(0.0, duration_s, 0.01)
    assert np.abs(motion.tip_base(times) - scene.dimple_base).max() < 1e-9
    shafts = motion.shaft_base(times)
    first = shafts[0]
    reached = np.arccos(np.clip(shafts @ first, -1, 1))
    assert np.rad2deg(reached.max()) == pytest.approx(cone_deg, abs=1.0)
    flat = shafts - (shafts @ first)[:, None] * first
    spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    assert spread[1] > 0.6 * spread[0]  # both directions, not rocking in a plane


@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
@pytest.mark.parametrize("kind", ["pivot", "sweep", "draw", "stroke"])
def test_the_tracker_sees_nearly_every_frame(pointer, kind):
    for seed in range(4):
        scene, operator = operator_of(seed, pointer)
        duration_s = prepare(operator, kind, scene)
        poses = operator.motion().Ts_base_pointermarker(np.linspace(0.0, duration_s, 150))
        Ts_tracker_marker = scene.T_base_tracker.inv() @ poses
        geometry = GEOMETRIES[pointer]
        white = np.zeros((150, *geometry.positions_marker.shape))
        exact = TrackerSettings(profile="ideal")
        statuses = observe(geometry, Ts_tracker_marker, white, exact, seed).statuses
        assert statuses.count("ok") > 0.95 * len(statuses)


def test_the_hand_trembles_between_six_and_twelve_hertz():
    _, operator = operator_of(4)
    center, _, _ = operator_of(4)[0].region_base()
    operator.stroke([center], duration_s=60.0)
    times = np.arange(0.0, 60.0, 0.01)
    tips = operator.motion().tip_base(times)
    off = tips - tips.mean(axis=0)
    power = (np.abs(np.fft.rfft(off, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(times), 0.01)
    band = (frequency > 5.5) & (frequency < 12.5)
    tremor_mm = np.sqrt(2 * power[band].sum()) / len(times)
    assert 0.2 < tremor_mm < 0.4
    assert power[frequency > 13.0].sum() < 1e-3 * power[band].sum()


def test_the_same_ordinal_gives_the_same_motion_and_another_one_another():
    def tips(ordinal, seed=7):
        _, operator = operator_of(seed, ordinal=ordinal)
        operator.draw(spacing_mm=5.0, duration_s=10.0)
        return operator.motion().tip_base(np.linspace(0, 10, 50))

    np.testing.assert_array_equal(tips(2), tips(2))
    assert np.abs(tips(2) - tips(3)).max() > 0.1
    assert np.abs(tips(2) - tips(2, seed=8)).max() > 0.1


def test_motion_begins_and_ends_at_rest_and_stays_at_its_ends():
    _, operator = operator_of(1)
    duration_s = operator.draw(spacing_mm=5.0, duration_s=10.0)
    motion = operator.motion()
    np.testing.assert_array_equal(motion.tip_base(duration_s + 9.0), motion.tip_base(duration_s))
    np.testing.assert_array_equal(motion.tip_base(-1.0), motion.tip_base(0.0))


def test_a_stroke_passes_its_places_in_order():
    scene, operator = operator_of(2)
    center, _, _ = scene.region_base()
    skull = scene.T_base_skull
    places = center + np.array([(0, 0, 0), (15, 0, 0), (15, 15, 0), (-10, 12, 0)], dtype=float)
    places = skull @ scene.specimen.closest(skull.inv() @ places)
    duration_s = operator.stroke(places, duration_s=8.0)
    tips = operator.motion().tip_base(np.arange(0.0, duration_s, 0.01))
    distances = np.linalg.norm(tips[:, None] - places[None], axis=2)
    assert distances.min(axis=0).max() < 1.5  # the tremor
    assert (np.diff(distances.argmin(axis=0)) > 0).all()


def test_a_place_beyond_the_specimen_is_refused_by_its_number():
    scene, operator = operator_of(2)
    center, normal, _ = scene.region_base()
    away = center + (PICK_REACH_MM + 5.0) * normal
    with pytest.raises(InvalidInputError, match=r"pick 2 of 3 .* 20 mm beyond the specimen") as e:
        operator.stroke([center, away, center], duration_s=5.0)
    assert e.value.data == {"pick": 2}
    assert operator.motion() is None


class Colander(SphereSpecimen):
    """A sphere that rays pass through on one side."""

    def ray(self, origins_skull, directions_skull):
        hit = super().ray(origins_skull, directions_skull)
        off = np.asarray(origins_skull) - self.region.center_skull
        return np.where(off @ (0.36, -0.8, 0.0) > 0.0, np.inf, hit)


def test_a_region_full_of_holes_is_refused():
    scene, operator = operator_of(2, specimen=Colander())
    with pytest.raises(InvalidInputError, match="holes"):
        operator.sweep(duration_s=10.0)
    assert scene is not None


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda o: o.pivot(cone_deg=0.0, duration_s=10.0), "cone_deg"),
        (lambda o: o.pivot(cone_deg=float("nan"), duration_s=10.0), "cone_deg"),
        (lambda o: o.pivot(cone_deg=20.0, duration_s=0.5), "duration_s"),
        (lambda o: o.sweep(duration_s=1e6), "duration_s"),
        (lambda o: o.draw(spacing_mm=80.0, duration_s=10.0), "spacing_mm"),
        (lambda o: o.draw(spacing_mm=-1.0, duration_s=10.0), "spacing_mm"),
        (lambda o: o.draw(spacing_mm=0.0, duration_s=10.0), "spacing_mm"),
        (lambda o: o.stroke([], duration_s=10.0), "picks_base"),
        (lambda o: o.stroke([[0, 0, float("nan")]], duration_s=10.0), "picks_base"),
    ],
)
def test_what_no_hand_can_do_is_refused(call, word):
    with pytest.raises(InvalidInputError, match=word):
        call(operator_of()[1])


@settings(max_examples=40)
@given(st.floats(5.0, 60.0), st.floats(0.5, 8.0))
def test_a_meander_stays_in_its_disc_keeps_its_spacing_and_has_no_corners(radius_mm, spacing_mm):
    curve = raster_curve(radius_mm, min(spacing_mm, radius_mm))
    spacing_mm = min(spacing_mm, radius_mm)
    assert np.linalg.norm(curve, axis=1).max() <= radius_mm * (1 + 1e-12)
    steps = np.diff(curve, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    assert lengths.max() < 0.25
    directions = steps[lengths > 1e-6] / lengths[lengths > 1e-6][:, None]
    turn = np.arccos(np.clip((directions[1:] * directions[:-1]).sum(axis=1), -1, 1))
    assert turn.max() < 2.2 * np.pi / 8 if spacing_mm < 1 else turn.max() < 0.4
    ys = np.unique(np.round(curve[:-1][np.abs(directions_y(curve)) < 1e-9, 1], 9))
    np.testing.assert_allclose(np.diff(ys), spacing_mm, atol=1e-6)


def directions_y(curve):
    steps = np.diff(curve, axis=0)
    return steps[:, 1]


@settings(max_examples=25)
@given(seeds, st.integers(1, 6))
def test_a_curve_through_places_passes_them_all(seed, n):
    points = np.random.default_rng(seed).uniform(-20, 20, (n, 3))
    curve = interpolating_curve(np.repeat(points, 2, axis=0))
    distances = np.linalg.norm(curve[:, None] - points[None], axis=2)
    assert distances.min(axis=0).max() < 1e-9
    low, high = points.min(axis=0), points.max(axis=0)
    assert ((curve >= low - 1e-9) & (curve <= high + 1e-9)).all()  # no overshoot


def test_walking_along_a_curve_is_even():
    square = np.array([(0, 0), (10, 0), (10, 10), (0, 10.0)])
    walked = points_along(square, np.linspace(0, 1, 31))
    np.testing.assert_allclose(np.linalg.norm(np.diff(walked, axis=0), axis=1), 1.0)
