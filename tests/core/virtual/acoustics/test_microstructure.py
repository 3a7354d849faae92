import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rona_core.ultrasound.probe.beam as beams
from rona_core.ultrasound.probe.probe_model import PROBES
from rona_core.virtual.acoustics.microstructure import CELL_MM, RMS, texture

seeds = st.integers(0, 2**32 - 1)
MORE_RAYS = (8, 12, 14, 18, 20, 22, 24, 26, 28, 28)  # 200


@given(seed=seeds)
@settings(max_examples=10)
def test_texture_is_white_in_depth_and_the_same_everywhere(seed):
    points = np.random.default_rng(seed).uniform(-80, 80, (3000, 3))
    g = texture(points, seed, 9)
    assert abs(g.mean()) < 0.03
    assert abs(g.std() - RMS) < 0.02
    correlation = np.corrcoef(g.T) - np.eye(9)
    assert np.abs(correlation).max() < 0.1


@given(seed=seeds)
@settings(max_examples=10)
def test_texture_is_smooth_and_other_seeds_have_another(seed):
    points = np.random.default_rng(seed).uniform(-80, 80, (2000, 3))
    here = texture(points, seed, 6)
    np.testing.assert_array_equal(here[:50], texture(points[:50], seed, 6))
    assert np.abs(texture(points + (0.0, 0.0, 0.01), seed, 6) - here).max() < 0.05
    for other in (texture(points + (0.0, 0.0, 4.0), seed, 6), texture(points, seed + 1, 6)):
        assert abs(np.corrcoef(here.ravel(), other.ravel())[0, 1]) < 0.05


@pytest.mark.parametrize("lean_deg", [0.0, 5.0])
def test_half_the_rays_meet_the_same_grain_as_loud_as_independent_cells(monkeypatch, lean_deg):
    """The echo of one layer of grain under a face belongs to the bone: rays but sample it."""
    probe, found, cells = PROBES["2.25MHz"], [], 0.0
    random = np.random.default_rng(0)
    places = random.uniform(-60.0, 60.0, (40, 3))
    turns = [np.linalg.qr(random.normal(size=(3, 3)))[0] for _ in places]
    for counts in (beams.RING_RAYS, MORE_RAYS):
        monkeypatch.setattr(beams, "RING_RAYS", counts)
        beam = beams.probe_beam.__wrapped__(probe)
        weights = beam.weights[:, np.argmin(np.abs(beam.frequencies_mhz - probe.centre_mhz))]
        areas = beams.face_rays(beams.FACE_OVER_APERTURE * probe.aperture_radius_mm)[1]
        cells = CELL_MM**2 * np.sum(np.abs(weights) ** 2 / areas)
        k = 4.0 * np.pi * probe.centre_mhz / 1.5 * np.tan(np.deg2rad(lean_deg))
        waves = weights * np.exp(-1j * k * beam.points_mm[:, 0])
        flat = np.column_stack((beam.points_mm, np.zeros(len(waves))))
        found.append(
            [waves @ texture(p + flat @ t, 3, 12) for p, t in zip(places, turns, strict=True)]
        )
    few, many = np.array(found)
    power = np.mean(np.abs(many) ** 2)
    assert np.sqrt(np.mean(np.abs(few - many) ** 2) / power) < 0.1
    assert abs(10.0 * np.log10(power / cells)) < 2.0
