"""The scenes that detection is tuned with and judged by must themselves be right."""

import numpy as np
import pytest

from rona_core.ultrasound.probe.probe_model import probe_model
from tests.scenes import bone_scenes
from tests.scenes.bone_shapes import Dome, grid_places, leans_rad


def test_a_dome_is_a_sphere_met_along_its_axis():
    dome = Dome(6.0, 80.0)
    rng = np.random.default_rng(1)
    xy = rng.uniform(-10, 10, (30, 2))
    starts = np.column_stack((xy, np.full(30, -5.0)))
    lean = leans_rad(rng, 30, 0.0, 4.0)
    down = np.column_stack((lean, np.ones(30)))
    down /= np.linalg.norm(down, axis=1)[:, None]
    hit = starts + dome.layers(starts, down)[:, :1] * down
    np.testing.assert_allclose(np.linalg.norm(hit - (0, 0, 80.0), axis=1), 80.0, atol=1e-9)


def test_a_plate_with_a_wedge_is_met_where_its_planes_are():
    plate = Dome(6.0, slopes=(0.05, -0.02), shares=(0.3, 0.7))
    starts = np.array([(2.0, -3.0, -5.0), (-4.0, 1.0, -5.0)])
    found = plate.layers(starts, np.tile((0.0, 0.0, 1.0), (2, 1))) - 5.0
    thickness = 6.0 + starts[:, :2] @ (0.05, -0.02)
    np.testing.assert_allclose(found, thickness[:, None] * (0.0, 0.3, 0.7, 1.0), atol=1e-12)


@pytest.mark.parametrize("tilt_deg", [0.7, 2.5])
def test_relief_has_the_tilt_that_was_asked_for(tilt_deg):
    slopes = []
    for seed in range(30):
        bone = Dome(6.0).with_relief(np.random.default_rng(seed), np.deg2rad(tilt_deg), 30.0)
        xy = np.random.default_rng(99).uniform(-40, 40, (200, 2))
        for step in ((1e-4, 0.0), (0.0, 1e-4)):
            slopes.append((bone.thickness_z(xy + step) - bone.thickness_z(xy - step)) / 2e-4)
    rms = np.sqrt(2.0 * np.mean(np.square(slopes)))
    assert rms == pytest.approx(np.deg2rad(tilt_deg), rel=0.15)


def test_a_pose_stands_on_the_dome_and_looks_to_its_middle():
    pose = Dome(6.0, 80.0).pose((7.0, -4.0), 0.5, (0.0, 0.0))
    to_middle = (0.0, 0.0, 80.0) - pose.translation
    assert np.linalg.norm(to_middle) == pytest.approx(80.5)
    np.testing.assert_allclose(to_middle / 80.5, pose.rotation[:, 2], atol=1e-12)


def test_a_meander_steps_by_its_pitch():
    places, cells = grid_places(5, 2.0)
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), 2.0)
    np.testing.assert_allclose(places.mean(axis=0), 0.0)
    assert len({tuple(cell) for cell in cells}) == 25


@pytest.mark.sweep(1)
@pytest.mark.parametrize("name", ["2.25MHz", "1MHz"])
@pytest.mark.parametrize("inner_snr_db", [10.0, 25.0])
def test_the_noise_of_a_plate_is_the_one_asked_for(name, inner_snr_db):
    """Inner echo of a pulse, its peak, over the rms in the -6 dB band."""
    scene = bone_scenes.plate(6.0, inner_snr_db, name=name, n=24)
    loud = bone_scenes.plate(6.0, 120.0, name=name, n=24)  # the probe's least noise
    noise = (scene.track.rf - loud.track.rf).astype(np.float64)
    f = np.fft.rfftfreq(noise.shape[1], 1.0 / scene.probe.sampling_mhz)
    spectrum = np.fft.rfft(noise, axis=1)
    half = scene.probe.bandwidth * scene.probe.centre_mhz / 2.0
    spectrum[:, np.abs(f - scene.probe.centre_mhz) > half] = 0.0
    in_band = np.fft.irfft(spectrum, noise.shape[1], axis=1).std()
    # 6 mm at the true speed behind the front echo, alone in its window
    front = np.argmax(np.abs(loud.track.rf), axis=1)
    late = np.rint(scene.bone_us * scene.probe.sampling_mhz).astype(int)
    reach = round(0.9 / scene.probe.centre_mhz * scene.probe.sampling_mhz)
    peaks = [
        np.abs(rf[at + by - reach : at + by + reach]).max()
        for rf, at, by in zip(loud.track.rf, front, late, strict=True)
    ]
    measured = 20.0 * np.log10(np.median(peaks) / in_band)
    assert measured == pytest.approx(inner_snr_db, abs=2.5)  # the tail of the front echo is there


def test_truth_is_consistent_and_scenes_repeat():
    scene, again = (
        bone_scenes.hard_bone(6.0, side=4, nominal=False, drawn_seed=900_000) for _ in range(2)
    )
    np.testing.assert_array_equal(scene.track.rf, again.track.rf)
    np.testing.assert_allclose(
        scene.speed_mm_per_us * scene.bone_us, 2.0 * scene.thickness_mm, rtol=1e-12
    )
    assert scene.probe == probe_model(scene.settings)
    assert np.all((scene.thickness_mm > 5.0) & (scene.thickness_mm < 7.0))
    assert np.all(scene.inner_tilt_deg < 12.0)
    # where the axis enters the bone lies on the outer face
    rise = scene.points_skull[:, 2]
    radius = np.linalg.norm(scene.points_skull[:, :2], axis=1)
    assert np.all((rise >= -1e-9) & (rise <= radius**2 / 100.0 + 1e-9))


def test_anatomical_bone_is_a_skull_with_its_own_inner_table():
    scene = bone_scenes.anatomical_bone(3, radius_mm=8.0, lines_mm=4.0)
    assert len(scene) > 40
    assert np.median(scene.outer_tilt_deg) < 2.0
    assert np.median(scene.inner_tilt_deg) > 1.5 * np.median(scene.outer_tilt_deg)
    other = bone_scenes.anatomical_bone(
        3, radius_mm=8.0, lines_mm=4.0, nominal=False, drawn_seed=900_000
    )
    assert other.thickness_mm[0] != scene.thickness_mm[0]
