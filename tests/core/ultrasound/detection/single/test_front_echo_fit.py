"""What is taken away before an inner echo is timed: gap, shapes of the front, the second echo."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.echo_timing import spectrum_bound
from rona_core.ultrasound.detection.detect import nominal_bone
from rona_core.ultrasound.detection.single.front_echo import (
    SHAPE_FLOOR,
    Rest,
    front_shapes,
    front_times,
    fronts_at,
    products,
    without_gap,
)
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
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
def test_fronts_smeared_by_tilt_are_taken_away_and_inner_echoes_are_not(name, excitation):
    template = block_template(probe_model(name), excitation)
    radius = template.probe.aperture_radius_mm
    across = np.linspace(-radius, radius, 41)
    rays = 2.0 * np.deg2rad(1.0) * across / GEL.speed_mm_per_us  # arrivals under a degree of tilt
    share = np.sqrt(radius**2 - across**2)
    front = BONE_REFLECTION * template.spectrum
    front = front * (share @ np.conj(template.shift(rays))) / share.sum()
    shapes, quiet = front_shapes(template), np.array([GRID * 1e-4**2])
    left = shapes.without(front[None], quiet)
    plain = (
        front
        - (front @ np.conj(template.spectrum))
        * template.spectrum
        / np.linalg.norm(template.spectrum) ** 2
    )
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(front)
    assert np.linalg.norm(left) < 0.2 * np.linalg.norm(plain)
    inner = bone_filter(template, BONE, 8.0) * np.conj(template.shift(np.array([6.0])))
    kept = shapes.without(inner, quiet)
    assert np.linalg.norm(kept - inner) < 0.2 * np.linalg.norm(inner)


@EVERY
def test_what_is_left_is_linear_and_its_own_adjoint(name, excitation):
    template = block_template(probe_model(name), excitation)
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 3, len(template.bins))) + 1j * rng.normal(
        size=(2, 3, len(template.bins))
    )
    density = np.array([1e-6, 1e-3, 1.0])
    again = bone_filter(template, BONE, 12.0) * np.conj(template.shift(np.full(3, 9.0)))
    rest = Rest(front_shapes(template), density, again, np.ones(3))
    np.testing.assert_allclose(products(a, rest.of(b)), products(rest.of(a), b), rtol=1e-9)
    np.testing.assert_allclose(rest.of(a + 2.0 * b), rest.of(a) + 2.0 * rest.of(b), atol=1e-9)
    # an inverse covariance: never more than the white part of it, never below 0
    power, left = products(a, a).real, products(a, rest.of(a)).real
    assert np.all((left >= 0.0) & (left <= power * (1.0 + 1e-12)))


@EVERY
def test_the_rest_is_the_inverse_of_the_covariance_of_all_that_may_be_there(name, excitation):
    template = block_template(probe_model(name), excitation)
    shapes, density = front_shapes(template), np.array([GRID * 3e-3**2])
    again = bone_filter(template, BONE, 12.0) * np.conj(template.shift(np.array([9.0])))
    # the finest shapes are believed less than their power: never finer than the floor
    power = shapes.power * density / (density + SHAPE_FLOOR * shapes.power[0])
    parts = np.column_stack((shapes.shapes.T * np.sqrt(power), 0.7 * again[0]))
    covariance = parts @ parts.conj().T / density + np.eye(len(template.bins))
    spectrum = np.random.default_rng(8).normal(size=(1, len(template.bins))) + 0.0j
    found = Rest(shapes, density, again, np.array([0.7])).of(spectrum)[0]
    np.testing.assert_allclose(found, np.linalg.solve(covariance, spectrum[0]), atol=1e-7)


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
