"""The bone of the stored k-Wave fields as their grid holds it: cut cells are mixed.

A cell that a boundary cuts holds the mean density and the mean compressibility of its parts, so
that it is a layer of its own, one cell thick. With nine or ten cells to a wave in water it costs a
front echo 0.5 dB where the boundary runs along the grid, and 0.9 dB where it leans and cuts cells
at all places. The rule is no guess: with it ``kspace_grid`` gives back all four stored fields.
"""

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Complexes, Material
from rona_core.virtual.acoustics.layered_reflection import stack_reflection

WATER, TABLE, DIPLOE = Material(1.5, 1.0), Material(2.85, 1.9), Material(2.45, 1.7)
LAYERS = (WATER, TABLE, DIPLOE, TABLE, Material(1.56, 1.04))  # water above, brain below
THICKNESSES_MM = (2.0, 2.5, 1.5)


def mixed(near: Material, far: Material, share: float) -> Material:
    """Return what a cell holds that is the far material by ``share`` and the near one else."""
    materials, shares = (near, far), (1.0 - share, share)
    density = sum(s * m.density_g_per_cm3 for s, m in zip(shares, materials, strict=True))
    softness = sum(
        s / (m.density_g_per_cm3 * m.speed_mm_per_us**2)
        for s, m in zip(shares, materials, strict=True)
    )
    return Material(float(1.0 / np.sqrt(density * softness)), float(density))


def layers_in_cells(
    edges_mm: Floats, cell_mm: float
) -> tuple[tuple[Material, ...], tuple[float, ...], float]:
    """Return materials, thicknesses between, and where the first cut cell begins.

    Args:
        edges_mm: Depths of the boundaries of ``LAYERS`` below the middle of a cell (4,).
        cell_mm: Size of a cell.

    Raises:
        InvalidInputError: one cell is cut by two boundaries.
    """
    tops = (np.round(edges_mm / cell_mm) - 0.5) * cell_mm
    if np.any(np.diff(tops) < 1.5 * cell_mm):
        raise InvalidInputError("a layer must be thicker than two cells")
    materials, thicknesses = [LAYERS[0]], []
    for i, (edge, top) in enumerate(zip(edges_mm, tops, strict=True)):
        if i:
            thicknesses.append(float(top - tops[i - 1] - cell_mm))
        share = (top + cell_mm - edge) / cell_mm
        materials += [mixed(LAYERS[i], LAYERS[i + 1], float(share)), LAYERS[i + 1]]
        thicknesses.append(cell_mm)
    return tuple(materials), tuple(thicknesses), float(tops[0])


def echo_in_cells(
    weights: Complexes, frequencies_mhz: Floats, edges_mm: Floats, cell_mm: float, reach_mm: float
) -> Complexes:
    """Return the echo (f,) of the bone in cells under rays of these weights (n, f).

    Args:
        weights: Length times squared incident field at the depth ``reach_mm``.
        frequencies_mhz: Shape (f,).
        edges_mm: Depths of the boundaries under each ray (n, 4), below the source.
        cell_mm: Size of a cell.
        reach_mm: Depth at which the field is given.
    """
    echo = np.zeros(len(frequencies_mhz), dtype=np.complex128)
    k = WATER.wavenumber_per_mm(frequencies_mhz)
    for weight, edges in zip(weights, edges_mm, strict=True):
        materials, thicknesses, first = layers_in_cells(edges, cell_mm)
        there = np.exp(-2j * k * (first - reach_mm))
        echo += weight * there * stack_reflection(materials, thicknesses, frequencies_mhz)
    return echo
