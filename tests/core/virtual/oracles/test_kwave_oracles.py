"""Layers and reciprocity of the beam against stored solutions of the wave equation."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.virtual.acoustics.layered_reflection import stack_reflection
from tests.oracles import kwave_cases
from tests.oracles.kwave_cases import (
    STRIPS,
    bone_echo,
    mirror_level_db,
    plane_wave,
    strip,
)
from tests.oracles.kwave_cells import (
    LAYERS,
    THICKNESSES_MM,
    WATER,
    echo_in_cells,
    layers_in_cells,
    mixed,
)

EXACT = pytest.mark.parametrize("exact", [False, True])
EDGES_MM = 10.0 + np.concatenate(([0.0], np.cumsum(THICKNESSES_MM)))


def here(comparison):
    if comparison is None:
        pytest.skip(f"no reference fields in {kwave_cases.SHARED}")
    return comparison


@pytest.mark.sweep(1)
@EXACT
def test_four_layers_agree_with_the_wave_equation(exact):
    """Five media in 1D within 1.5 %: the grid itself is good to 1.3 %."""
    found = here(plane_wave(exact))
    assert found.l2_error < 0.015
    assert abs(found.front_db) < 0.05
    assert abs(found.front_ns) < 2.0


@pytest.mark.sweep(2)
@EXACT
@pytest.mark.parametrize("name", STRIPS)
def test_a_strip_aperture_agrees_with_the_wave_equation(name, exact):
    found = here(strip(name, exact))
    assert found.correlation > 0.99
    assert abs(found.front_ns) < 31.0


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", [name for name in STRIPS if "tilt" not in name])
def test_sharp_bone_that_does_not_lean_echoes_within_half_a_decibel_of_the_field(name):
    """Under a lean the cells of the field cost its echo more; see the next test for all four."""
    assert abs(here(strip(name)).front_db) < 0.5


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", STRIPS)
def test_tilt_and_curvature_cost_what_they_cost_in_the_wave_equation(name):
    """Front echo within half a decibel of the same grid's perpendicular flat bone."""
    flat = here(strip(f"{name.split('_')[0]}_flat"))
    assert abs(here(strip(name)).front_db - flat.front_db) < 0.5


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", STRIPS)
def test_bone_in_the_cells_of_the_field_echoes_as_loud_as_the_field(name):
    """Like beside like: flat, curved and tilted front echoes within 0.15 dB and 4 ns."""
    found = here(strip(name, cells=True))
    assert abs(found.front_db) < 0.15
    assert abs(found.front_ns) < 4.0
    assert found.correlation > 0.995


def test_cells_without_size_are_sharp():
    f, gap = np.linspace(0.5, 4.0, 40), np.array([0.0, 0.07, 0.31])
    weights = np.exp(1j * np.outer(gap, f)) * np.array([[1.0], [0.5], [0.8]])
    sharp = bone_echo(weights, f, gap, 0.0, exact=True)
    cells = echo_in_cells(weights, f, EDGES_MM + gap[:, None], 1e-5, 10.0)
    np.testing.assert_allclose(cells, sharp, atol=1e-3)
    coarse = echo_in_cells(weights, f, EDGES_MM + gap[:, None], 0.075, 10.0)
    assert np.abs(coarse - sharp).max() > 0.05


def test_a_mixed_cell_is_its_parts_to_a_long_wave():
    """Mean density and mean compressibility: the difference falls with the square of size."""
    near, far, share, f = WATER, LAYERS[1], 1.0 / 3.0, np.array([1.0])

    def apart(cell_mm):
        parts = stack_reflection(
            (near, near, far, far), ((1 - share) * cell_mm, share * cell_mm), f
        )
        whole = stack_reflection((near, mixed(near, far, share), far), (cell_mm,), f)
        return abs(complex((whole - parts)[0]))

    assert mixed(near, far, 0.0) == near
    assert apart(0.004) / apart(0.002) == pytest.approx(4.0, rel=0.02)
    assert apart(0.002) < 1e-4


def test_cells_hold_one_boundary_each():
    materials, thicknesses, first = layers_in_cells(EDGES_MM, 0.15)
    assert len(materials) == 9
    assert first + sum(thicknesses) == pytest.approx(EDGES_MM[-1], abs=0.15)
    with pytest.raises(InvalidInputError, match="thicker"):
        layers_in_cells(EDGES_MM, 1.5)


@pytest.mark.parametrize("lean_deg", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("frequency_mhz", [1.5, 2.25, 3.0])
def test_rays_of_a_leaning_mirror_are_the_image_of_the_strip(lean_deg, frequency_mhz):
    assert abs(mirror_level_db(lean_deg, frequency_mhz, 3.175, 10.0)) < 0.1


def test_a_field_that_is_not_here_is_none(monkeypatch, tmp_path):
    monkeypatch.setattr(kwave_cases, "SHARED", tmp_path)
    assert plane_wave() is None
    assert strip("1mhz_flat") is None
