from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.echo_time_bounds import spectrum_bound
from rona_core.ultrasound.detection.detect import nominal_bone
from rona_core.ultrasound.detection.single.front_echo import fronts_at
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import BONE_REFLECTION, block_template
from rona_core.ultrasound.detection.single.time_of_flight import (
    EnvelopePeaks,
    choose_cycles,
    fit_inner,
)
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.probe_model import PROBES, probe_model

CASES = [(name, kind) for name in PROBES for kind in ("pulse", "chirp")]
EVERY = pytest.mark.parametrize(("name", "excitation"), CASES)
BONE = nominal_bone()


def behind_gel(template, bone, gap_mm):
    """Return aligned spectra (n, f) of bone reflecting ``bone`` (n, f) behind gaps (n,) of gel."""
    line = template.probe.line.speed_mm_per_us * template.probe.line.density_g_per_cm3
    face = (1.5 - line) / (1.5 + line)
    gel = np.conj(template.shift(2.0 * gap_mm / 1.5))
    exact = face + (1.0 - face**2) * gel * bone / (1.0 + face * gel * bone)
    return template.spectrum * exact / gel


def heard_at(gap_mm, probe):
    """Return fronts (n,) of good contact behind so much gel."""
    return replace(fronts_at(gap_mm, probe), snr=np.full(len(gap_mm), 1e3))


def spectra(template, thickness_mm, noise, n, seed):
    """Return front and inner echo in white noise (n, f), aligned to the front, lag and fronts."""
    rng = np.random.default_rng(seed)
    lag = 2.0 * thickness_mm / BONE.speed_mm_per_us
    inner = bone_filter(template, BONE, thickness_mm) * np.conj(template.shift(np.array([lag])))
    size = (n, len(template.bins))
    white = (rng.normal(size=size) + 1j * rng.normal(size=size)) * noise * np.sqrt(GRID / 2.0)
    gap_mm = rng.uniform(0.1, 1.5, n)
    sent = np.where(template.spectrum == 0.0, np.inf, template.spectrum)
    bone = np.repeat(BONE_REFLECTION + inner / sent, n, axis=0)
    seen = behind_gel(template, bone, gap_mm) + white
    return seen, lag, heard_at(gap_mm, template.probe)


def refined(template, thickness_mm, noise, n=120, seed=3, off_us=0.03):
    seen, lag, fronts = spectra(template, thickness_mm, noise, n, seed)
    start = np.full(n, lag + off_us)
    none = np.zeros(n)
    fits = fit_inner(
        seen, fronts, none + noise, EnvelopePeaks(start, none + 1.0, none), template, BONE
    )
    return fits, lag


@EVERY
def test_on_a_plate_the_scatter_is_that_of_the_bound(name, excitation):
    template = block_template(probe_model(name), excitation)
    noise = 2e-3 if excitation == "pulse" else 1e-2
    fits, lag = refined(template, 7.0, noise)
    found, sigma = choose_cycles(fits)
    echo = bone_filter(template, BONE, 7.0)
    bound = spectrum_bound(echo, template.frequencies_mhz, noise).coherent_us
    error = found - lag
    assert 0.85 < error.std() / bound < 1.25
    assert abs(error.mean()) < 0.5 * bound + 1e-3
    assert np.median(fits.noise_us) == pytest.approx(bound, rel=0.3)
    assert np.all(sigma >= fits.noise_us)


@EVERY
def test_without_noise_neither_gap_nor_front_moves_the_time(name, excitation):
    template = block_template(probe_model(name), excitation)
    fits, lag = refined(template, 7.0, 1e-6, n=24)
    error = choose_cycles(fits)[0] - lag
    assert error.std() < 2e-4
    assert np.abs(error).max() < 1e-3


def test_a_front_known_from_elsewhere_is_not_moved_by_what_is_heard():
    template = block_template(probe_model("2.25MHz"), "pulse")
    seen, lag, heard = spectra(template, 6.0, 1e-4, 5, 2)
    known = replace(heard, snr=np.full(5, np.inf))
    late = seen * np.conj(template.shift(np.array([0.02])))  # all of it, by 20 ns
    none = np.zeros(5)
    args = (none + 1e-4, EnvelopePeaks(none + lag, none + 1.0, none), template, BONE)
    follows, stays = (fit_inner(late, fronts, *args).phase_us for fronts in (heard, known))
    np.testing.assert_allclose(follows, lag, atol=2e-3)
    np.testing.assert_allclose(stays - lag, 0.02, atol=2e-3)


def test_the_start_within_a_cycle_does_not_matter():
    template = block_template(probe_model("2.25MHz"), "pulse")
    fits = [refined(template, 6.0, 1e-3, n=5, off_us=off)[0] for off in (-0.08, 0.0, 0.08)]
    found = [choose_cycles(fit)[0] for fit in fits]
    np.testing.assert_allclose(found[0], found[1], atol=2e-3)
    np.testing.assert_allclose(found[2], found[1], atol=2e-3)


def test_where_the_cycle_is_in_doubt_sigma_says_so():
    template = block_template(probe_model("2.25MHz"), "pulse")
    lag = 2.0 * 6.0 / BONE.speed_mm_per_us
    _, loud = choose_cycles(refined(template, 6.0, 1e-3)[0])
    found, faint = choose_cycles(refined(template, 6.0, 2.5e-2)[0])
    assert np.median(faint) > 1.5 * np.median(loud)
    assert np.sqrt(np.mean(((found - lag) / faint) ** 2)) < 3.0


def test_those_around_decide_which_cycle_is_meant():
    template = block_template(probe_model("2.25MHz"), "pulse")
    fits, lag = refined(template, 6.0, 1e-3)
    envelope = fits.envelope_us + 0.5 * fits.period_us  # right between two cycles
    doubtful = replace(fits, envelope_us=envelope, envelope_sd_us=0.0 * envelope + 0.1)
    _, alone_sigma = choose_cycles(doubtful)
    found, sigma = choose_cycles(doubtful, 0.0 * envelope + lag + 0.05, 0.0 * envelope + 0.05)
    np.testing.assert_allclose(found, lag, atol=0.01)
    assert np.all(sigma < 0.3 * alone_sigma)
