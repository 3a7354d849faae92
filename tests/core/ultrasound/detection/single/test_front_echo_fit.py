"""The gap taken away before an inner echo is timed, and the time of its front."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.echo_timing import spectrum_bound
from rona_core.ultrasound.detection.detect import nominal_bone
from rona_core.ultrasound.detection.single.front_echo import (
    front_times,
    fronts_at,
    without_gap,
)
from rona_core.ultrasound.detection.single.matched_filter import BONE_REFLECTION, block_template
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import GEL, TABLE
from rona_core.ultrasound.probe.probe_model import PROBES, probe_model
from rona_core.virtual.acoustics.layered_reflection import stack_reflection

EVERY = pytest.mark.parametrize(
    ("name", "excitation"), [(name, kind) for name in PROBES for kind in ("pulse", "chirp")]
)
BONE = nominal_bone()


@EVERY
@pytest.mark.parametrize("gap_mm", [0.1, 0.4, 1.3])
def test_without_the_gap_an_exact_front_is_the_template(name, excitation, gap_mm):
    template = block_template(probe_model(name), excitation)
    f = template.frequencies_mhz
    lossless = [replace(m, attenuation_db_per_cm=0.0) for m in (template.probe.line, GEL, TABLE)]
    front = stack_reflection(lossless, (gap_mm,), f) * template.spectrum
    aligned = (front * template.shift(np.array([2.0 * gap_mm / GEL.speed_mm_per_us])))[:1]
    fronts = replace(fronts_at(np.array([gap_mm]), template.probe), snr=np.array([1e3]))
    expected = BONE_REFLECTION * template.spectrum
    before, after = (
        np.linalg.norm(x - expected) / np.linalg.norm(expected)
        for x in (aligned, without_gap(aligned, fronts, template))
    )
    assert before > 5e-3
    assert after < 3e-4


def test_of_a_front_that_was_not_heard_nothing_is_taken_away():
    template = block_template(probe_model("2.25MHz"), "pulse")
    known = fronts_at(np.array([0.5]), template.probe)
    nothing = np.zeros((1, len(template.bins)), dtype=np.complex128)
    np.testing.assert_array_equal(without_gap(nothing, known, template), nothing)
    heard = replace(known, snr=np.array([1e3]))
    assert np.abs(without_gap(nothing, heard, template)).max() > 0.0


@EVERY
def test_a_front_is_timed_at_the_bound(name, excitation):
    template = block_template(probe_model(name), excitation)
    rng = np.random.default_rng(6)
    delays, noise = rng.uniform(-5e-3, 5e-3, 200), 2e-3
    size = (200, len(template.bins))
    white = (rng.normal(size=size) + 1j * rng.normal(size=size)) * noise * np.sqrt(GRID / 2.0)
    front = BONE_REFLECTION * template.spectrum
    found = front_times(front * np.conj(template.shift(delays)) + white, template)
    bound = spectrum_bound(front, template.frequencies_mhz, noise).coherent_us
    assert (found - delays).std() / bound == pytest.approx(1.0, abs=0.15)
    assert abs((found - delays).mean()) < 0.3 * bound
