import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference.matched_filter_throughput import peak_times
from rona_core.ultrasound.detection.single.front_echo import (
    find_fronts,
    gate_us,
    standoff_mm,
    subtract_fronts,
)
from rona_core.ultrasound.detection.single.matched_filter import (
    BONE_REFLECTION,
    block_template,
    trace_spectra,
)
from rona_core.ultrasound.probe.probe_model import PROBES, probe_model

CASES = [(name, kind) for name in PROBES for kind in ("pulse", "chirp")]
EVERY = pytest.mark.parametrize(("name", "excitation"), CASES)


def echoes(template, delays_us, amplitudes):
    """Return spectra (n, f) of block echoes at delays (n, k) with amplitudes (n, k)."""
    total = 0.0
    for delay, amplitude in zip(delays_us.T, amplitudes.T, strict=True):
        total = total + amplitude[:, None] * np.conj(template.shift(delay))
    return total * template.spectrum


@EVERY
def test_the_template_compresses_itself_to_one_at_its_delay(name, excitation):
    template = block_template(probe_model(name), excitation)
    z = template.compress(template.spectrum[None, :], template.spectrum)[0]
    assert z[0] == pytest.approx(1.0)
    assert np.abs(z).max() <= 1.0 + 1e-9


@EVERY
def test_the_noise_gain_is_what_white_noise_becomes(name, excitation):
    probe = probe_model(name)
    template = block_template(probe, excitation)
    noise = np.random.default_rng(5).normal(0.0, 0.02, (60, 4096))
    spectra, measured = trace_spectra(noise, 0.0, template)
    z = template.compress(spectra, template.spectrum)
    expected = 0.02 * template.noise_gain(template.spectrum)
    assert np.sqrt(np.mean(np.abs(z) ** 2)) == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(measured.mean(), 0.02, rtol=0.03)


@EVERY
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_a_front_echo_is_timed_to_a_nanosecond_wherever_it_lies(name, excitation, seed):
    probe = probe_model(name)
    template = block_template(probe, excitation)
    early, late = gate_us(probe)
    delay = np.random.default_rng(seed).uniform(early + 0.2, late - 0.2, (5, 1))
    spectra = echoes(template, probe.line_delay_us + delay, np.full((5, 1), BONE_REFLECTION))
    front = find_fronts(spectra, np.full(5, 1e-4), template)
    np.testing.assert_allclose(front.delay_us, delay[:, 0], atol=2e-3)
    np.testing.assert_allclose(front.level, 1.0, atol=0.02)
    assert front.positive.all()
    mirrored = find_fronts(-spectra, np.full(5, 1e-4), template)
    assert not mirrored.positive.any()


@given(x=st.floats(-2.0, 2.0))
def test_the_standoff_undoes_the_way_through_line_film_and_gel(x):
    probe = probe_model("2.25MHz")
    gel = max(x, probe.film_mm)
    line = x - gel  # by how much the line is shorter
    delay = np.array((2 * gel / 1.5 + 2 * line / probe.line.speed_mm_per_us,))
    assert standoff_mm(delay, probe)[0] == pytest.approx(x, abs=1e-12)


@EVERY
def test_subtracting_the_front_leaves_the_inner_echo_and_little_else(name, excitation):
    probe = probe_model(name)
    template = block_template(probe, excitation)
    lag = 2 * 7.0 / 2.65
    both = echoes(template, np.array([[0.05, lag]]), np.array([[0.5, -0.03]]))
    inner = echoes(template, np.array([[lag]]), np.array([[-0.03]]))
    left = template.compress(subtract_fronts(both, template), template.spectrum)[0]
    pure = template.compress(inner, template.spectrum)[0]
    late = slice(int(2.0 / template.step_us), int(8.0 / template.step_us))
    assert np.abs(left - pure)[late].max() < 0.3 * 0.03
    assert np.abs(left[: int(0.8 / template.step_us)]).max() < 0.05 * 0.5


@EVERY
def test_the_batch_finds_the_delay_of_each_echo(name, excitation):
    template = block_template(probe_model(name), excitation)
    delay = np.array([[3.0], [7.5], [12.25]])
    full = np.zeros((3, 2049), dtype=np.complex128)
    full[:, template.bins] = echoes(template, delay, np.ones((3, 1)))
    rf = np.fft.irfft(full, 4096)[:, :2048].astype(np.float32)
    found = peak_times(template, rf)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, delay[:, 0], atol=0.12)


@EVERY
def test_an_echo_that_noise_drowns_is_matched_and_not_equalised(name, excitation):
    noisy = block_template(probe_model(name), excitation, 0.01)
    same = noisy.weighed_for(noisy.spectrum)
    np.testing.assert_allclose(same.weights, noisy.weights, rtol=1e-12)
    faint = 1e-4 * noisy.spectrum
    drowned = noisy.weighed_for(faint)
    # no filter hears more of it than the matched one; the equalised one hears less
    best = np.sqrt(np.sum(np.abs(faint) ** 2) / 4096)
    assert 1.0 / drowned.noise_gain(faint) == pytest.approx(best, rel=0.01)
    assert 1.0 / noisy.noise_gain(faint) < 0.97 * best
    silent = block_template(probe_model(name), excitation)
    np.testing.assert_allclose(silent.weighed_for(faint).weights, silent.weights, rtol=1e-12)
