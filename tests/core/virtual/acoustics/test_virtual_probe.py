import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, probe_model
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import VirtualProbe, hexagon, receiver_noise
from tests.helpers.ultrasound_scenes import Plates, Shells, StillClock

NOISELESS = ProbeSettings(excitation="pulse", front_snr_db=90.0)


def rig(specimen=None, medium=None, settings=NOISELESS, seed=3, ordinal=0):
    clock, pose = StillClock(), [Pose.identity()]
    probe = VirtualProbe(
        clock, lambda times: pose[0].repeated(len(times)), specimen or Plates(), medium
    )
    probe.begin(settings, seed, ordinal)
    return probe, clock, pose


def test_a_firing_depends_on_its_time_and_not_on_the_polling():
    probe, clock, _ = rig(settings=ProbeSettings())
    clock.time_s = 0.25
    lonely = probe.acquire()
    for clock.time_s in (0.0, 0.1, 0.2):
        probe.acquire()
    clock.time_s = 0.25
    np.testing.assert_array_equal(probe.acquire().rf, lonely.rf)
    clock.time_s = 0.26
    assert np.any(probe.acquire().rf != lonely.rf)
    for seed, ordinal in ((4, 0), (3, 1)):
        other, other_clock, _ = rig(settings=ProbeSettings(), seed=seed, ordinal=ordinal)
        other_clock.time_s = 0.25
        assert np.any(other.acquire().rf != lonely.rf)


@pytest.mark.parametrize("shots", [1, 16])
@pytest.mark.parametrize("name", ["2.25MHz", "1MHz"])
def test_the_noise_in_the_band_is_as_set_and_falls_with_the_root_of_the_shots(name, shots):
    settings = ProbeSettings(name=name, front_snr_db=40.0, shots=shots)
    probe, clock, pose = rig(settings=settings)
    pose[0] = Pose.from_translation((0.0, 0.0, -5.0))
    traces = []
    for clock.time_s in np.arange(60) * 0.01:
        traces.append(probe.acquire().rf)
    noise = np.array(traces) - np.mean(traces, axis=0)
    model = probe_model(name)
    f = np.fft.rfftfreq(noise.shape[1], 1 / model.sampling_mhz)
    half = model.bandwidth * model.centre_mhz / 2
    outside = np.abs(f - model.centre_mhz) > half
    spectrum = np.fft.rfft(noise, axis=1)
    spectrum[:, outside] = 0.0
    in_band = np.fft.irfft(spectrum, noise.shape[1], axis=1).std()
    found = 20 * np.log10(FULL_SCALE_SHARE / in_band)
    assert found == pytest.approx(settings.averaged_snr_db, abs=0.7)


def test_no_average_lowers_noise_that_every_shot_repeats():
    levels = [receiver_noise(ProbeSettings(shots=n), probe_model("2.25MHz")) for n in (1, 32, 128)]
    assert 20 * np.log10(levels[0] / levels[1]) == pytest.approx(15.0, abs=0.15)
    assert levels[2] > 1.02 * levels[0] / np.sqrt(128)
    assert levels[2] < levels[1]


def test_contact_is_kept_within_the_compliance_and_lost_beyond():
    probe, _, pose = rig()
    peak = {}
    for lift in (-2.2, -1.9, -1.0, 0.0, 1.0, 1.9, 2.2):
        pose[0] = Pose.from_translation((0.0, 0.0, -lift))
        rf = probe.acquire().rf
        peak[lift] = rf[np.argmax(np.abs(rf))]
    assert all(peak[lift] > 0.35 for lift in (-1.9, -1.0, 0.0, 1.0, 1.9))
    assert all(peak[lift] < -0.6 for lift in (-2.2, 2.2))


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_moving_skull_and_probe_together_changes_nothing_but_the_texture(seed):
    """Smooth bone: the trace knows only the pose of the probe relative to the skull."""
    medium = Medium(outer_roughness_mm=0.0, inner_roughness_mm=0.0, speckle=0.0)
    rng = np.random.default_rng(seed)
    probe, _, pose = rig(Shells(80.0), medium)
    here = probe.acquire().rf
    centre = np.array((0.0, 0.0, 80.0))
    turn = Pose.from_rotvec(rng.normal(0.0, 0.5, 3))  # about the centre of the shells
    pose[0] = Pose(turn.rotation, centre - turn.rotation @ centre)
    np.testing.assert_allclose(probe.acquire().rf, here, atol=3e-4)


def test_curvature_delays_the_front_by_the_mean_sag():
    flat, curved = (
        rig(specimen, Medium(speckle=0.0, outer_roughness_mm=0.0))[0].acquire().rf
        for specimen in (Plates(), Shells(60.0))
    )
    step = 20
    flat, curved = (np.repeat(rf, step) for rf in (flat, curved))
    window = slice(0, 500 * step)
    lags = np.arange(-200, 201)
    score = [np.dot(np.roll(flat, lag)[window], curved[window]) for lag in lags]
    late_us = lags[int(np.argmax(score))] / (50.0 * step)
    sag_mm = 3.175**2 / (4 * 60.0)  # a^2 / 4 R
    assert late_us == pytest.approx(2 * sag_mm / 1.55, rel=0.5)


def test_a_probe_beside_the_bone_hears_air():
    probe, _, pose = rig(Shells(20.0))
    pose[0] = Pose.from_translation((40.0, 0.0, 0.0))
    rf = probe.acquire().rf
    assert rf[np.argmax(np.abs(rf))] < -0.6


def test_samples_lie_on_the_converters_steps_and_are_frozen():
    scan = rig(settings=ProbeSettings(front_snr_db=20.0))[0].acquire()
    np.testing.assert_array_equal(scan.rf, np.rint(scan.rf * 2**13) / 2**13)
    assert not scan.rf.flags.writeable
    assert scan.clipped == bool(np.abs(scan.rf).max() >= 1.0)


def test_heavy_noise_clips_and_says_so():
    scan = rig(settings=ProbeSettings(front_snr_db=5.0, shots=1))[0].acquire()
    assert scan.clipped
    assert scan.rf.max() < 1.0
    assert scan.rf.min() >= -1.0


def test_a_closed_probe_refuses_and_may_be_closed_twice():
    probe, _, _ = rig()
    probe.close()
    probe.close()
    with pytest.raises(DeviceError, match="closed"):
        probe.acquire()


def test_the_first_cast_ray_is_the_axis():
    points = hexagon(3.0, 3)
    assert len(points) == 37
    np.testing.assert_array_equal(points[0], (0.0, 0.0))
    assert np.hypot(*points.T).max() == pytest.approx(3.0)
