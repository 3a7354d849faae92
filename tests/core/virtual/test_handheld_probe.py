import numpy as np
import pytest

from rona_core.compose import specimen_of
from rona_core.devices.settings import SONO, TOOLS, DeviceSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from rona_core.session.document import Setup
from rona_core.virtual.operator.hand_trajectories import MOST_TILT_RAD, PLAY_MM, PRESSED_MM
from rona_core.virtual.operator.operator import VirtualOperator
from rona_core.virtual.rig import build_scene
from rona_core.virtual.world.world import NOMINAL


@pytest.fixture(scope="module")
def scene():
    return build_scene(5, specimen_of(Setup(seed=5)), DeviceSettings(), NOMINAL)


def held(scene, ordinal=3):
    operator = VirtualOperator(scene)
    operator.begin(scene, DeviceSettings(), ordinal)
    operator.hold(SONO)
    return operator


def true_probes(scene, motion, times):
    return list(motion.Ts_base_pointermarker(np.asarray(times)) @ scene.T_sonomarker_probe)


def test_the_probe_is_made_nearly_as_its_maker_says_and_comes_after_those_before_it():
    assert TOOLS[:5] == ("toolmarker", "pointer6d", "pointer5d", "basemarker", SONO)
    off, lean = [], []
    for seed in range(30):
        scene = build_scene(seed, specimen_of(Setup(seed=5)), DeviceSettings(), NOMINAL)
        T = scene.T_sonomarker_probe
        off.append(np.linalg.norm(T.translation - GEOMETRIES[SONO].nominal_tip_marker))
        lean.append(np.rad2deg(np.arccos(-T.rotation[1, 2])))
    assert 1.0 <= min(off)
    assert max(off) <= 3.0
    assert 0.7 < np.sqrt(np.mean(np.square(lean))) / (0.8 * np.sqrt(2)) < 1.4


def test_in_the_bush_the_true_axis_stays_and_the_marker_turns(scene):
    operator = held(scene)
    operator.spin(half_turn_deg=70.0, duration_s=15.0)
    motion = operator.motion()
    probes = true_probes(scene, motion, np.linspace(0.0, 15.0, 400))
    axes = np.array([p.rotation[:, 2] for p in probes])
    wobble = np.rad2deg(np.arccos(np.clip(axes @ axes.mean(axis=0), -1, 1)))
    assert np.sqrt(np.mean(wobble**2)) < 0.25
    faces = np.array([p.translation for p in probes])
    assert np.abs(faces - scene.dimple_base).max() < 6 * PLAY_MM
    x = np.array([p.rotation[:, 0] for p in probes])
    turned = np.rad2deg(np.arctan2(np.cross(x[0], x) @ axes.mean(axis=0), x @ x[0]))
    assert 130.0 < np.ptp(turned) < 142.0


def test_pivoted_on_its_calibration_point_the_true_face_rests(scene):
    operator = held(scene)
    operator.pivot(cone_deg=25.0, duration_s=10.0)
    probes = true_probes(scene, operator.motion(), np.linspace(0.0, 10.0, 60))
    faces = np.array([p.translation for p in probes])
    np.testing.assert_allclose(faces, np.tile(scene.dimple_base, (60, 1)), atol=1e-6)


def test_slid_over_the_bone_it_is_pressed_on_and_leans_by_a_few_degrees(scene):
    operator = held(scene)
    operator.slide_probe(spacing_mm=2.0, duration_s=40.0)
    times = np.linspace(0.0, 40.0, 800)
    probes = true_probes(scene, operator.motion(), times)
    T_skull_base = scene.T_base_skull.inv()
    faces = np.array([p.translation for p in probes])
    axes = np.array([p.rotation[:, 2] for p in probes])
    back = T_skull_base @ (faces - 20.0 * axes)
    pressed = 20.0 - scene.specimen.ray(back, T_skull_base.rotate(axes))
    assert pressed.min() > PRESSED_MM[0] - 0.1
    assert pressed.max() < PRESSED_MM[1] + 0.1
    assert np.ptp(pressed) > 0.8
    normals = scene.specimen.normal(scene.specimen.closest(T_skull_base @ faces))
    leans = np.arccos(-(T_skull_base.rotate(axes) * normals).sum(axis=1))
    assert leans.max() < MOST_TILT_RAD + np.deg2rad(2.0)
    assert 1.5 < np.rad2deg(np.sqrt(np.mean(leans**2))) < 4.5
    center, normal, radius = scene.region_base()
    flat = faces - center - ((faces - center) @ normal)[:, None] * normal
    assert radius - 2.0 < np.linalg.norm(flat, axis=1).max() < radius + 4.0


def test_senseless_motions_are_refused(scene):
    operator = held(scene)
    with pytest.raises(InvalidInputError, match="half_turn_deg"):
        operator.spin(half_turn_deg=120.0, duration_s=15.0)
    with pytest.raises(InvalidInputError, match="duration_s"):
        operator.slide_probe(spacing_mm=2.0, duration_s=0.5)
    with pytest.raises(InvalidInputError, match="spacing_mm"):
        operator.slide_probe(spacing_mm=60.0, duration_s=20.0)
