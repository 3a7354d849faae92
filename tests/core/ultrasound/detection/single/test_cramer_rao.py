import numpy as np
import pytest

from benchmarks.reference.echo_time_bounds import (
    inner_bound,
    inner_noise,
    spectrum_bound,
)
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.detection.detect import nominal_bone
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.probe_model import PROBES, probe_model

CASES = [(name, kind) for name in PROBES for kind in ("pulse", "chirp")]
EVERY = pytest.mark.parametrize(("name", "excitation"), CASES)


def trace(template, spectrum, delay_us, phase_rad=0.0):
    """Return the samples of an echo at a delay, its carrier turned by a phase."""
    full = np.zeros(GRID // 2 + 1, dtype=np.complex128)
    shifted = spectrum * np.exp(-2j * np.pi * template.frequencies_mhz * delay_us)
    full[template.bins] = shifted * np.exp(1j * phase_rad)
    return np.fft.irfft(full, GRID)


@EVERY
def test_both_bounds_are_those_of_the_numerical_fisher_information(name, excitation):
    template, bone, noise = block_template(probe_model(name), excitation), nominal_bone(), 1e-3
    echo = bone_filter(template, bone, 6.0)
    h = 1e-5
    slope = (trace(template, echo, 8.0 + h) - trace(template, echo, 8.0 - h)) / (2 * h)
    turn = (trace(template, echo, 8.0, h) - trace(template, echo, 8.0, -h)) / (2 * h)
    height = trace(template, echo, 8.0)
    bound = spectrum_bound(echo, template.frequencies_mhz, noise)
    known = np.stack((slope, height)) / noise  # amplitude unknown, phase known
    free = np.stack((slope, height, turn)) / noise
    coherent, envelope = (np.sqrt(np.linalg.inv(d @ d.T)[0, 0]) for d in (known, free))
    assert bound.coherent_us == pytest.approx(coherent, rel=1e-4)
    assert bound.envelope_us == pytest.approx(envelope, rel=1e-4)
    assert bound.coherent_us < bound.envelope_us


@EVERY
def test_ten_times_the_signal_to_noise_ratio_is_ten_times_as_sharp(name, excitation):
    probe = probe_model(name)
    pulse, sent = block_template(probe, "pulse"), block_template(probe, excitation)
    low, high = (inner_bound(pulse, nominal_bone(), 6.0, snr, sent) for snr in (20.0, 40.0))
    assert low.coherent_us / high.coherent_us == pytest.approx(10.0, rel=1e-9)
    if excitation == "chirp":  # the same noise, and many times the energy
        assert low.coherent_us < 0.5 * inner_bound(pulse, nominal_bone(), 6.0, 20.0).coherent_us


def test_the_noise_is_what_the_ratio_asks_for():
    template = block_template(probe_model("2.25MHz"), "pulse")
    bone = nominal_bone()
    noise = inner_noise(template, bone, 6.0, 20.0)
    peak = np.abs(trace(template, bone_filter(template, bone, 6.0), 5.0)).max()
    in_band = noise * np.sqrt(0.46 * 2.25 / 25.0)
    assert 20 * np.log10(peak / in_band) == pytest.approx(20.0, abs=0.3)


def test_without_noise_or_echo_there_is_no_bound():
    template = block_template(probe_model("1MHz"), "pulse")
    with pytest.raises(InvalidInputError, match="noise"):
        spectrum_bound(template.spectrum, template.frequencies_mhz, 0.0)
    with pytest.raises(InvalidInputError, match="echo"):
        spectrum_bound(0.0 * template.spectrum, template.frequencies_mhz, 1.0)
