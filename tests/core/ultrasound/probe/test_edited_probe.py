"""A probe that somebody changed, a warm delay line, a receiver turned up: what the record shows."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.signal import hilbert

from rona_core.devices.limits import limits_of, range_of
from rona_core.devices.settings import ROOM_C, ProbeSettings
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.probe.probe_model import AQUALENE, PROBES, ProbeModel, probe_model
from rona_core.virtual.acoustics.delay_line import warmed
from rona_core.virtual.acoustics.probe import VirtualProbe
from tests.helpers.ultrasound_scenes import Plates, StillClock

PULSE = ProbeSettings(excitation="pulse", front_snr_db=90.0)


def fire(settings, specimen=None, medium=None, pose=None):
    here = pose or Pose.identity()
    probe = VirtualProbe(
        StillClock(), lambda times: here.repeated(len(times)), specimen or Plates(), medium
    )
    probe.begin(settings, 3, 0)
    return probe.acquire()


def front_us(scan):
    envelope = np.abs(hilbert(scan.rf))
    return scan.start_us + float(np.argmax(envelope)) / scan.sampling_mhz


@pytest.mark.parametrize("name", list(PROBES))
def test_nothing_changed_is_the_named_probe(name):
    assert probe_model(ProbeSettings(name=name)) == PROBES[name] == probe_model(name)


def test_every_change_reaches_the_model_in_its_unit():
    model = probe_model(
        ProbeSettings(
            centre_mhz=3.5, bandwidth=0.6, aperture_mm=5.0, line_length_mm=12.0,
            pulse_shape="double", adc_bits=12, gain_db=6.0,
        )
    )  # fmt: skip
    wanted = replace(
        PROBES["2.25MHz"], centre_mhz=3.5, bandwidth=0.6, aperture_radius_mm=2.5,
        line_length_mm=12.0, pulse_shape="double", adc_bits=12, gain_db=6.0,
    )  # fmt: skip
    assert model == wanted


def test_what_a_laboratory_does_not_know_is_not_in_the_model():
    assert probe_model(ProbeSettings(line_temperature_c=37.0)) == PROBES["2.25MHz"]
    assert "temperature" not in " ".join(part.name for part in fields(ProbeModel))


LIMITED = [name for name, words in limits_of(ProbeSettings).items() if "minimum" in words]


@pytest.mark.parametrize("field", LIMITED)
def test_limits_hold_on_both_sides(field):
    low, high = range_of(ProbeSettings, field)
    for value in (low, high):
        assert getattr(ProbeSettings(**{field: value}), field) == value
    for value in (low - 1e-3, high + 1e-3, np.nan):
        with pytest.raises(InvalidInputError, match=field):
            ProbeSettings(**{field: value})


def test_an_unknown_pulse_is_refused():
    with pytest.raises(InvalidInputError, match="ringing, not 'square'"):
        ProbeSettings(pulse_shape="square")


@pytest.mark.sweep(4)
@pytest.mark.parametrize("name", list(PROBES))
@pytest.mark.parametrize(
    "change",
    [
        {"line_length_mm": 8.0},
        {"line_length_mm": 25.0},
        {"centre_mhz": 0.5, "aperture_mm": 20.0},
        {"centre_mhz": 5.0, "bandwidth": 0.9, "aperture_mm": 3.0},
    ],
)
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
def test_at_its_limits_a_probe_still_works(name, change, excitation):
    scan = fire(ProbeSettings(name=name, excitation=excitation, front_snr_db=80.0, **change))
    assert np.isfinite(scan.rf).all()
    assert 0.3 < np.abs(scan.rf).max() < 0.75
    quiet = scan.rf[-25:]
    assert np.abs(quiet).max() < 0.2 * np.abs(scan.rf).max()


def test_a_smaller_face_is_less_sensitive_to_tilt():
    lean = Pose.from_rotvec((np.deg2rad(3.0), 0.0, 0.0))
    loss = {}
    for aperture in (3.0, 6.35):
        settings = replace(PULSE, aperture_mm=aperture)
        loss[aperture] = (
            np.abs(fire(settings, pose=lean).rf).max() / np.abs(fire(settings).rf).max()
        )
    assert loss[3.0] > 1.4 * loss[6.35]


@pytest.mark.parametrize("rise", [-8.0, 10.0, 15.0])
def test_a_warm_line_delays_the_front_by_its_own_slowness(rise):
    """Rubber slows down by 2.5 m/s a kelvin: 15 mm there and back, timed for 22 degrees."""
    model = PROBES["2.25MHz"]
    cold, warm = (fire(replace(PULSE, line_temperature_c=t)) for t in (ROOM_C, ROOM_C + rise))
    assert (cold.start_us, len(cold.rf)) == (warm.start_us, len(warm.rf))
    way = 2.0 * model.line_length_mm
    expected = way / (AQUALENE.speed_mm_per_us - 0.0025 * rise) - way / AQUALENE.speed_mm_per_us
    assert front_us(warm) - front_us(cold) == pytest.approx(expected, abs=0.021)


def test_a_warm_line_loses_less_and_room_temperature_changes_nothing():
    assert warmed(AQUALENE, 0.0) == AQUALENE
    hot = warmed(AQUALENE, 40.0 - ROOM_C)
    assert hot.attenuation_db_per_cm < AQUALENE.attenuation_db_per_cm
    peaks = [np.abs(fire(replace(PULSE, line_temperature_c=t)).rf).max() for t in (ROOM_C, 40.0)]
    assert peaks[1] > peaks[0]


def test_gain_scales_echo_and_noise_alike_until_the_converter_clips():
    settings = ProbeSettings(excitation="pulse", front_snr_db=30.0, shots=1)
    plain, louder, loud = (fire(replace(settings, gain_db=g)) for g in (0.0, 3.0, 20.0))
    np.testing.assert_allclose(louder.rf, plain.rf * 10 ** (3 / 20), atol=2e-4)
    assert not louder.clipped
    assert loud.clipped
    assert loud.rf.max() < 1.0
    assert (np.abs(loud.rf) > 0.999).sum() > 5


def test_a_coarse_converter_has_coarse_steps():
    scan = fire(replace(PULSE, adc_bits=6))
    np.testing.assert_array_equal(scan.rf, np.rint(scan.rf * 32) / 32)
