from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from rona_core.devices.protocols import Rig
from rona_core.devices.settings import DeviceSettings, RobotSettings, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DeviceError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.document import RegionChoice, Setup
from rona_core.session.specimen import SimulatedSkull
from tests.helpers.sphere_world import SphereSpecimen, signed_distance

pytest.importorskip("rona_core.virtual.robot.robot", reason="there is no virtual robot")
pytest.importorskip("rona_core.virtual.acoustics.probe", reason="there is no virtual probe")
from rona_core.compose import build_virtual_rig
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.specimen.build_specimen import build_specimen

EXACT = DeviceSettings(tracker=TrackerSettings(profile="ideal"), robot=RobotSettings(errors=False))


@pytest.fixture
def rig():
    rig = VirtualRig(3, SphereSpecimen(), EXACT)
    yield rig
    rig.close()


def probe_over_region(rig, gap_mm):
    """Joint angles that hold the probe over the middle of the region, ``gap_mm`` off the bone."""
    center, normal, _ = rig.display.region()
    model = rig.model
    for roll in np.linspace(0.0, 2 * np.pi, 36, endpoint=False):
        x = np.array((np.cos(roll), np.sin(roll), 0.0))
        x -= (x @ normal) * normal
        x /= np.linalg.norm(x)
        pose = Pose(np.column_stack((x, np.cross(-normal, x), -normal)), center + gap_mm * normal)
        T_base_flange = pose @ model.T_flange_probe.inv()
        found = model.inverse(Poses.stack([T_base_flange]))
        room = model.limits.clearance_rad(found.qs_rad[0]).min(axis=1)
        best = int(np.argmax(np.where(found.valid[0], room, -np.inf)))
        if found.valid[0, best] and room[best] > 0.0:
            return found.qs_rad[0, best]
    raise AssertionError("the region cannot be reached")


def test_it_is_a_rig(rig):
    as_rig: Rig = rig
    assert as_rig.origin == "VIRTUAL"
    assert as_rig.clock.now() == 0.0


def test_the_tracker_sees_the_tool_where_the_robot_holds_it(rig):
    model, scene = rig.model, rig.scene
    sample = rig.tracker.latest().tool("toolmarker")
    assert sample.status == "ok"
    T_base_tip = model.forward(rig.robot.state().q_rad[None])[0] @ model.T_flange_tip
    expected = T_base_tip @ scene.T_tip_toolmarker
    found = scene.T_base_tracker @ sample.T_tracker_marker
    np.testing.assert_allclose(found.matrix(), expected.matrix(), atol=1e-8)


def test_a_moving_robot_moves_the_marker_with_the_clock(rig):
    q = rig.robot.state().q_rad
    times = np.linspace(0.0, 1.0, 21)
    rig.robot.move(times, q + (0.05 - 0.05 * np.cos(np.pi * times))[:, None])
    model, scene = rig.model, rig.scene
    for frame in islice(rig.tracker.frames(), 60):
        q_now = rig.robot.q_at(frame.time_s)
        T_base_tip = model.forward(q_now[None])[0] @ model.T_flange_tip
        found = scene.T_base_tracker @ frame.tool("toolmarker").T_tracker_marker
        expected = T_base_tip @ scene.T_tip_toolmarker
        np.testing.assert_allclose(found.matrix(), expected.matrix(), atol=1e-8)


def test_only_the_pointer_in_the_hand_is_seen(rig):
    assert rig.display.T_base_pointermarker() is None
    for pointer, other in (("pointer6d", "pointer5d"), ("pointer5d", "pointer6d")):
        rig.begin(replace(EXACT, pointer=pointer), 1)
        assert rig.tracker.latest().tool(pointer).status == "out_of_view"
        rig.operator.draw(spacing_mm=5.0, duration_s=4.0)
        frame = rig.tracker.latest()
        assert frame.tool(pointer).status == "ok"
        assert frame.tool(other).status == "out_of_view"
        tip = rig.scene.T_base_tracker @ (
            frame.tool(pointer).T_tracker_marker @ rig.scene.tips[pointer]
        )
        true = rig.display.T_base_pointermarker() @ rig.scene.tips[pointer]
        np.testing.assert_allclose(tip, true, atol=1e-8)
        assert (
            abs(signed_distance(rig.scene.specimen, (rig.scene.T_base_skull.inv() @ tip)[None])[0])
            < 1e-3
        )


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_head_on_the_table_has_right_front_and_top(side):
    specimen = build_specimen(SimulatedSkull(side), 5)
    rig = VirtualRig(5, specimen, EXACT)
    axes, skull = rig.display.head_axes_base(), rig.display.skull_mesh_base()
    center, normal, _ = rig.display.region()
    rig.close()
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0.0
    right, front, top = axes.T
    out = center - skull.vertices.mean(axis=0)
    assert (out @ right > 30.0) == (side == "right")
    assert (normal @ right > 0.7) == (side == "right")
    assert out @ front < 0.0  # behind the ear canal
    size = np.ptp(skull.vertices @ axes, axis=0)
    assert size[1] == size.max()  # a head is longer than wide
    assert top @ (-1.0, 0.0, 0.0) > 0.8  # the top of the head lies towards the robot


def test_a_specimen_that_does_not_say_has_no_axes(rig):
    assert rig.display.head_axes_base() is None


def test_the_probe_hears_bone_where_it_touches_and_none_where_it_is_lifted(rig):
    def energy(gap_mm):
        rig.robot.place(probe_over_region(rig, gap_mm))
        rf = np.asarray(rig.probe.acquire().rf, dtype=np.float64)
        return float((rf**2).sum())

    rig.begin(EXACT, 1)
    touching, nearly, lifted = energy(0.0), energy(1.0), energy(12.0)
    assert touching != nearly
    assert abs(touching - lifted) > 0.05 * max(touching, lifted)


def test_beginning_puts_the_clock_back_and_the_pointer_away(rig):
    rig.operator.sweep(duration_s=5.0)
    rig.clock.wait_until(3.0)
    rig.begin(EXACT, 2)
    assert rig.clock.now() == 0.0
    assert rig.display.T_base_pointermarker() is None


def test_a_motion_that_was_cut_short_leaves_the_robot_where_it_was(rig):
    q = rig.robot.state().q_rad
    times = np.linspace(0.0, 2.0, 11)
    rig.robot.move(times, q + 0.1 * times[:, None] / 2.0)
    rig.clock.wait_until(1.0)
    rig.begin(EXACT, 2)
    np.testing.assert_allclose(rig.robot.state().q_rad, q + 0.05, atol=1e-9)


def test_moving_the_base_moves_what_is_drawn(rig):
    before, _, _ = rig.display.region()
    moved = replace(EXACT, robot=replace(EXACT.robot, base_shift_mm=(100.0, 0.0, 0.0)))
    rig.begin(moved, 1)
    after, _, _ = rig.display.region()
    np.testing.assert_allclose(before - after, (100.0, 0.0, 0.0), atol=1e-9)
    assert rig.scene.settings == moved
    mesh = rig.display.skull_mesh_base()
    distances = signed_distance(rig.scene.specimen, rig.scene.T_base_skull.inv() @ mesh.vertices)
    np.testing.assert_allclose(distances, 0.0, atol=1e-6)


def test_two_rigs_of_one_seed_measure_the_same(rig):
    noisy = DeviceSettings()

    def run(pace):
        other = VirtualRig(5, SphereSpecimen(), noisy, pace)
        other.begin(noisy, 4)
        other.operator.draw(spacing_mm=6.0, duration_s=2.0)
        frames = list(islice(other.tracker.frames(), 30))
        other.clock.wait_until(1.0)
        scan = other.probe.acquire()
        other.close()
        return frames, scan

    (a, scan_a), (b, scan_b) = run(None), run(50.0)
    for x, y in zip(a, b, strict=True):
        for tool in ("toolmarker", "pointer6d"):
            np.testing.assert_array_equal(
                x.tool(tool).T_tracker_marker.matrix(), y.tool(tool).T_tracker_marker.matrix()
            )
    np.testing.assert_array_equal(scan_a.rf, scan_b.rf)


def test_a_region_that_was_picked_is_where_it_was_picked():
    setup = Setup(region=RegionChoice(radius_mm=20.0))
    display = build_virtual_rig(setup).display
    center, normal, _ = display.region()
    picked = display.pick(center + 100.0 * normal + (8.0, 5.0, 0.0), -normal)
    wanted = tuple(display.point_mesh(picked).tolist())
    apart = np.linalg.norm(display.point_mesh(center) - wanted)
    assert apart == pytest.approx(np.linalg.norm(picked - center), abs=1e-6)
    again = build_virtual_rig(replace(setup, region=RegionChoice(wanted, 20.0))).display
    placed = again.point_mesh(again.region()[0])
    np.testing.assert_allclose(placed, wanted, atol=0.3)  # put onto the surface


def test_a_pick_meets_the_bone_or_nothing(rig):
    center, normal, _ = rig.display.region()
    hit = rig.display.pick(center + 100.0 * normal, -3.0 * normal)
    np.testing.assert_allclose(hit, center, atol=1e-6)
    assert rig.display.pick(center + 100.0 * normal, normal) is None
    with pytest.raises(InvalidInputError, match="direction_base"):
        rig.display.pick(center, np.zeros(3))


def test_closing_ends_the_devices_and_twice_is_safe(rig):
    rig.close()
    rig.close()
    with pytest.raises(DeviceError):
        rig.tracker.latest()
    with pytest.raises(DeviceError):
        rig.probe.acquire()


def test_the_tool_marker_faces_the_tracker_all_through_the_tool_motion():
    tool_motion = pytest.importorskip(
        "rona_core.robot.planning.calibration_motion", reason="no tool motion"
    )
    for seed in range(3):
        rig = VirtualRig(seed, SphereSpecimen(), DeviceSettings())
        plan = tool_motion.plan_tool_motion(rig.model)
        rig.begin(DeviceSettings(), 1)
        rig.robot.place(plan.qs_rad[0])
        rig.robot.move(plan.times_s, plan.qs_rad)
        numbers = np.arange(0, int(plan.times_s[-1] * 60), 15)
        status = [rig.tracker.frame(int(k)).tool("toolmarker").status for k in numbers]
        rig.close()
        assert status.count("ok") == len(status)


def test_the_nominal_mounting_puts_the_tip_where_the_geometry_says(rig):
    model = rig.model
    T_toolmarker_tip = model.T_flange_toolmarker.inv() @ model.T_flange_tip
    np.testing.assert_allclose(
        T_toolmarker_tip.translation, GEOMETRIES["toolmarker"].nominal_tip_marker, atol=1e-9
    )
