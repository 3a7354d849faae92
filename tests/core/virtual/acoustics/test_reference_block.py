import numpy as np
import pytest
from scipy.signal import hilbert

from rona_core.devices.settings import ProbeSettings
from rona_core.ultrasound.probe.beam import mirror_spectrum
from rona_core.ultrasound.probe.excitation import GRID, emission_spectrum
from rona_core.ultrasound.probe.probe_model import AQUALENE, PROBES
from rona_core.virtual.acoustics.delay_line import warmed
from rona_core.virtual.acoustics.plates import (
    STEEL,
    SteelFace,
    record_block,
    steel_medium,
)
from tests.helpers.ultrasound_scenes import Plates

PULSE = {"excitation": "pulse", "front_snr_db": 80.0}


def delay_samples(a, b):
    """Return by how many samples (a fraction too) record ``a`` comes after ``b``."""
    n, fine = 4096, 32
    cross = np.fft.rfft(a, n) * np.conj(np.fft.rfft(b, n))
    score = np.fft.irfft(cross, n * fine)
    at = int(np.argmax(score))
    return (at if at < n * fine // 2 else at - n * fine) / fine


def test_the_face_is_a_plane():
    origins = np.array([(1.0, 2.0, -12.0), (0.0, 0.0, -3.0)])
    down = np.tile((0.0, 0.0, 1.0), (2, 1))
    planes = Plates(depths=(0.0, 10.0, 20.0, 30.0)).layers(origins, down)
    np.testing.assert_allclose(SteelFace().layers(origins, down), planes)


@pytest.mark.parametrize("name", list(PROBES))
def test_a_block_shows_the_echo_that_detection_knows_of_its_probe(name):
    """The face alone echoes: the shape of the record is mirror times emission, nothing behind."""
    probe = PROBES[name]
    rf = record_block(ProbeSettings(name=name, **PULSE), 1, seed=2).rf[0].astype(float)
    known = np.fft.irfft(emission_spectrum(probe, "pulse") * mirror_spectrum(probe), GRID)
    known = np.roll(known, round((probe.line_delay_us - probe.start_us) * probe.sampling_mhz))
    known = known[: len(rf)]
    lag = delay_samples(rf, known)
    assert abs(lag / probe.sampling_mhz) < 0.05  # the film is 0.1 mm, in a line pressed as much
    f = np.fft.rfftfreq(4096)
    moved = np.fft.irfft(np.fft.rfft(known, 4096) * np.exp(-2j * np.pi * f * lag), 4096)[: len(rf)]
    late = round((probe.line_delay_us * 0.9) * probe.sampling_mhz)  # before the second line echo
    assert np.corrcoef(moved[:late], rf[:late])[0, 1] > 0.995
    level = np.abs(hilbert(rf)).max()
    assert 0.6 < level < 1.0


@pytest.mark.parametrize("temperature_c", [15.0, 30.0, 37.0])
def test_the_block_tells_how_slow_a_warm_line_is(temperature_c):
    room, warm = (
        record_block(ProbeSettings(line_temperature_c=t, **PULSE), 1, seed=2)
        for t in (22.0, temperature_c)
    )
    late_us = delay_samples(warm.rf[0].astype(float), room.rf[0].astype(float)) / room.sampling_mhz
    true = warmed(AQUALENE, temperature_c - 22.0)
    way = 2.0 * PROBES["2.25MHz"].line_length_mm
    expected = way / true.speed_mm_per_us - way / AQUALENE.speed_mm_per_us
    assert late_us == pytest.approx(expected, abs=0.003)


def test_shots_differ_by_their_noise_alone_and_follow_the_seed():
    settings = ProbeSettings(front_snr_db=40.0)
    first, again, other = (record_block(settings, 3, seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first.rf, again.rf)
    assert np.any(first.rf != other.rf)
    assert 0.0 < np.abs(first.rf[0] - first.rf[1]).max() < 0.2
    assert not first.clipped.any()
    assert steel_medium().table == STEEL
