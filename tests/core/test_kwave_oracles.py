"""Layers and reciprocity of the beam against stored solutions of the wave equation."""

import pytest

from benchmarks import kwave_cases
from benchmarks.kwave_cases import STRIPS, mirror_level_db, plane_wave, strip

EXACT = pytest.mark.parametrize("exact", [False, True])


def here(comparison):
    if comparison is None:
        pytest.skip(f"no reference fields in {kwave_cases.SHARED}")
    return comparison


@EXACT
def test_four_layers_agree_with_the_wave_equation(exact):
    """Five media in 1D within 1.5 %: the grid itself is good to 1.3 %."""
    found = here(plane_wave(exact))
    assert found.l2_error < 0.015
    assert abs(found.front_db) < 0.05
    assert abs(found.front_ns) < 2.0


@EXACT
@pytest.mark.parametrize("name", STRIPS)
def test_a_strip_aperture_agrees_with_the_wave_equation(name, exact):
    found = here(strip(name, exact))
    assert found.correlation > 0.99
    assert abs(found.front_ns) < 31.0


@pytest.mark.parametrize("name", STRIPS)
def test_tilt_and_curvature_cost_what_they_cost_in_the_wave_equation(name):
    """Front echo within half a decibel of the same grid's perpendicular flat bone."""
    flat = here(strip(f"{name.split('_')[0]}_flat"))
    assert abs(flat.front_db) < 0.5
    assert abs(here(strip(name)).front_db - flat.front_db) < 0.5


@pytest.mark.parametrize("lean_deg", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("frequency_mhz", [1.5, 2.25, 3.0])
def test_rays_of_a_leaning_mirror_are_the_image_of_the_strip(lean_deg, frequency_mhz):
    assert abs(mirror_level_db(lean_deg, frequency_mhz, 3.175, 10.0)) < 0.1


def test_a_field_that_is_not_here_is_none(monkeypatch, tmp_path):
    monkeypatch.setattr(kwave_cases, "SHARED", tmp_path)
    assert plane_wave() is None
    assert strip("1mhz_flat") is None
