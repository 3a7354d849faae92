"""Each quantity is drawn as the page says, from a stream of its own, and does what it says."""

import re
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from rona_core.devices.limits import range_of
from rona_core.devices.settings import DeviceSettings, TrackerSettings
from rona_core.devices.world_settings import NOMINAL_WORLD, WorldSettings
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.specimen import BoneChoice
from rona_core.ultrasound.probe.probe_model import PROBES
from rona_core.virtual.acoustics.delay_line import WARMING_S, TrueLine
from rona_core.virtual.acoustics.medium import MEDIA, bone_medium
from rona_core.virtual.robot.accuracy_error import RobotError
from rona_core.virtual.robot.joint_errors import JointErrors
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.specimen.boundaries import Relief
from rona_core.virtual.specimen.simulated.patient_sampling import draw_patient
from rona_core.virtual.tracker.marker_error import marker_error
from rona_core.virtual.world.quantities import BONE_KINDS, QUANTITIES, Normal, Uniform
from rona_core.virtual.world.world import NOMINAL, World, draw_world
from tests.helpers.sphere_world import ShiftError, SphereSpecimen

PAGE = Path(__file__).parents[4] / "docs" / "world.md"
BONE = BoneChoice()


def world(seed=1, profile="realistic", **chosen):
    return draw_world(WorldSettings(profile, **chosen), BONE, seed)


@cache
def worlds(profile):
    return [world(seed, profile) for seed in range(400)]


def cell(spread):
    if isinstance(spread, Uniform):
        return f"U({spread.low:g}, {spread.high:g})"
    return f"N({spread.mean:g}, {spread.sd:g})"


def test_the_page_has_every_quantity_with_its_distributions():
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| ([^|]+) \| ([^|]+) \|", PAGE.read_text(), re.M)
    found = {name: (nominal, soft.strip(), hard.strip()) for name, nominal, soft, hard in rows}
    assert found == {
        name: (f"{q.nominal:g}", cell(q.realistic), cell(q.hard)) for name, q in QUANTITIES.items()
    }
    named = {part.name for part in fields(WorldSettings)} - {"profile"}
    assert named == set(QUANTITIES)
    assert named < {part.name for part in fields(World)}


@pytest.mark.parametrize("name", list(QUANTITIES))
@pytest.mark.parametrize("profile", ["realistic", "hard"])
def test_draws_follow_the_distribution_within_what_can_be_set(name, profile):
    values = np.array([getattr(one, name) for one in worlds(profile)])
    spread = getattr(QUANTITIES[name], profile)
    low, high = range_of(WorldSettings, name)
    assert low <= values.min()
    assert values.max() <= high
    if isinstance(spread, Normal):
        assert values.mean() == pytest.approx(spread.mean, abs=0.2 * spread.sd)
        assert np.abs(values - spread.mean).max() <= spread.most * spread.sd + 1e-12
    else:
        assert spread.low <= values.min()
        assert values.max() <= spread.high
        width = spread.high - spread.low
        assert values.mean() == pytest.approx((spread.low + spread.high) / 2, abs=0.08 * width)


def test_what_is_set_is_as_it_is_set_and_moves_nothing_else():
    drawn, chosen = world(5), world(5, bone_loss=0.7)
    assert chosen.bone_loss == 0.7
    for name in set(QUANTITIES) - {"bone_loss"}:
        assert getattr(drawn, name) == getattr(chosen, name)
    assert draw_world(NOMINAL_WORLD, BONE, 5).bone_loss == 1.0
    with pytest.raises(InvalidInputError, match=r"bone_loss must be 0\.5 to 2"):
        WorldSettings(bone_loss=3.0)


def test_some_patients_have_sharp_or_hard_bone_but_none_in_the_nominal_world():
    for profile, (sharp, hard) in BONE_KINDS.items():
        kinds = [one.bone.kind for one in worlds(profile)]
        assert kinds.count("sharp") / 400 == pytest.approx(sharp, abs=0.05)
        assert kinds.count("hard") / 400 == pytest.approx(hard, abs=0.05)
    asked = draw_world(WorldSettings("hard"), BoneChoice("sharp"), 3)
    assert asked.bone.kind == "sharp"


def test_bone_is_as_lossy_and_as_slow_as_drawn():
    drawn = replace(NOMINAL, bone_loss=1.5, bone_speed=0.95, gel_speed_mm_per_us=1.55, film_mm=0.3)
    found, plain = bone_medium(drawn), MEDIA["normal"]
    for name in ("table", "diploe"):
        a, b = getattr(found, name), getattr(plain, name)
        assert a.attenuation_db_per_cm == pytest.approx(1.5 * b.attenuation_db_per_cm)
        assert a.speed_mm_per_us == pytest.approx(0.95 * b.speed_mm_per_us)
    assert (found.gel.speed_mm_per_us, found.film_mm) == (1.55, 0.3)
    assert bone_medium(NOMINAL) == plain


def test_a_line_that_warms_and_is_strained_delays_its_echo():
    told = PROBES["2.25MHz"]
    line = TrueLine(told, 22.0, replace(NOMINAL, line_drift_k=10.0))
    assert line.probe == told
    times, none = np.array([0.0, WARMING_S, 1e4]), np.zeros(3)
    late = line.late_us(times, none)
    way = 2.0 * told.line_length_mm
    speed = told.line.speed_mm_per_us
    assert late[0] == 0.0
    assert late[2] == pytest.approx(way / (speed - 0.025) - way / speed, rel=1e-3)
    assert late[1] == pytest.approx((1 - np.exp(-1)) * late[2], rel=0.02)
    strained = TrueLine(told, 22.0, replace(NOMINAL, line_strain_share=0.1))
    pressed = np.array([0.0, 1.5])
    late = strained.late_us(np.zeros(2), pressed)
    left = way - 2.0 * pressed[1]
    assert late == pytest.approx([0.0, left / speed / (1 + 0.1 * 1.5 / 15.0) - left / speed])
    warm = TrueLine(told, 22.0, replace(NOMINAL, line_excess_k=10.0, pulse_loss=0.1))
    assert not warm.varies
    assert warm.probe.line.speed_mm_per_us == pytest.approx(speed - 0.025)
    assert warm.probe.centre_mhz == pytest.approx(0.9 * told.centre_mhz)


def test_the_probe_is_clamped_as_far_off_as_drawn():
    off = replace(NOMINAL, mounting_mm=0.3, mounting_deg=0.5).clamping
    assert np.linalg.norm(off.translation) == pytest.approx(0.3)
    cosine = (np.trace(off.rotation) - 1.0) / 2.0
    assert np.rad2deg(np.arccos(cosine)) == pytest.approx(0.5)
    assert np.array_equal(NOMINAL.clamping.matrix(), np.eye(4))


def test_the_spindle_sits_as_far_off_as_drawn_and_elsewhere_with_another_seed():
    off, other = (replace(NOMINAL, seed=seed, spindle_mm=0.4).spindle_off_tip for seed in (1, 2))
    assert (np.linalg.norm(off), np.linalg.norm(other)) == pytest.approx((0.4, 0.4))
    assert abs(off @ other) < 0.99 * 0.16
    assert not NOMINAL.spindle_off_tip.any()
    # a stream of its own: the probe sits off in another direction
    probe = replace(NOMINAL, seed=1, mounting_mm=0.4).clamping.translation
    assert abs(off @ probe) < 0.99 * 0.16


def test_the_outer_boundary_alone_is_uneven():
    random = np.random.default_rng(0)
    u = random.normal(0.0, 1.0, (4000, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    smooth, uneven = draw_patient(4).radii(u), draw_patient(4, Relief(outer_mm=0.1)).radii(u)
    off = uneven - smooth
    assert off[:, 0].std() == pytest.approx(0.1, rel=0.12)  # sutures are no deeper for it
    assert not off[:, 1:].any()


@pytest.mark.parametrize("name", ["rx90", "ur5", "ur10"])
def test_a_robot_that_errs_by_its_joints_has_its_size_and_depends_on_the_posture(name):
    model = robot_model(name)
    errors = JointErrors(3, model, 0.4)
    error = RobotError(3, joints=errors)
    random = np.random.default_rng(1)
    places = np.array(model.work_area.region_base) + random.uniform(-100.0, 100.0, (200, 3))
    found = []
    for roll in (0.0, np.pi / 2):
        turn = np.array([[np.cos(roll), np.sin(roll), 0], [np.sin(roll), -np.cos(roll), 0]])
        turn = np.vstack((turn, (0.0, 0.0, -1.0)))
        poses = Poses(np.tile(turn, (200, 1, 1)), places)
        solved = model.inverse(poses @ model.T_flange_tip.inv())
        reached = solved.valid.any(axis=1)
        qs = solved.qs_rad[np.arange(200), np.argmax(solved.valid, axis=1)]
        found.append((reached, error.systematic_mm(places, qs)))
        # without what is new in every motion, the true tip is off by the same
        tips = poses.select(reached)
        true = error.Ts_base_tip_true(tips, qs[reached], 0, np.zeros(len(tips), int))
        off = true.translations - tips.translations - found[-1][1][reached]
        assert np.ptp(off, axis=0).max() < 1e-12  # one repeatability error for one motion
    both = found[0][0] & found[1][0]
    assert both.sum() > 50
    size = np.sqrt((found[0][1][both] ** 2).sum(axis=1).mean())
    assert 0.1 < size < 1.0
    other = np.sqrt(((found[1][1] - found[0][1])[both] ** 2).sum(axis=1).mean())
    assert 0.02 < other < 2.0
    with pytest.raises(InvalidInputError, match="needs their angles"):
        error.systematic_mm(places)


def test_the_tracker_errs_by_its_share():
    points = np.array([[0.0, 0.0, -1900.0], [100.0, 50.0, -2000.0]])
    white = np.random.default_rng(2).normal(size=points.shape)
    whole, half = (
        marker_error(TrackerSettings(), 4).measure(points, white, s) - points for s in (1.0, 0.5)
    )
    np.testing.assert_allclose(half, 0.5 * whole, atol=1e-9)


def test_the_head_moves_as_far_as_drawn_and_rests_in_the_nominal_world():
    def scene(drawn):
        parts = {"robot_error": ShiftError(), "T_tip_toolmarker": Pose.identity()}
        return VirtualScene(1, SphereSpecimen(), DeviceSettings(), world=drawn, **parts)

    times = np.arange(0.0, 600.0, 0.1)
    moving = scene(replace(NOMINAL, head_drift_mm=0.3, breathing_mm=0.05))
    shifts = moving.head_shift_base(2, times)
    along = shifts @ moving.world.head_drift_base
    np.testing.assert_allclose(shifts, along[:, None] * moving.world.head_drift_base, atol=1e-12)
    assert 0.3 < np.abs(along).max() <= 0.35
    assert np.abs(np.diff(along)).max() < 0.05
    assert not np.array_equal(shifts, moving.head_shift_base(3, times))
    assert not scene(NOMINAL).head_shift_base(2, times).any()
