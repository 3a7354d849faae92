"""The wave equation on a grid as k-Wave solves it: what its cells make of a smooth boundary.

A k-space pseudospectral scheme with split density and staggered velocity (Tabei 2002, Treeby and
Cox 2010), in two dimensions or, with a single column, in one. A cell that a boundary cuts holds
the mean density and the mean compressibility of its parts, as the stored fields do.
"""

import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Material
from tests.oracles.kwave_cases import STRIPS, Comparison, Strip, stored_strip, strip_record
from tests.oracles.kwave_cells import LAYERS

Singles = NDArray[np.float32]
Phasors = NDArray[np.complexfloating]
ASIDE = 1.7  # half the width of the grid of a strip over that of the strip
DEEP_MM = 18.5  # grid that holds all layers of bone and some brain
BEHIND_MM = 3.0  # grid below the middle of the bone, where its front echo alone is wanted
LAYER_CELLS = 20  # of the absorbing layer around the grid
LAYER_NEPER = 2.0  # its loss in the last cell
MARGIN_CELLS = 6  # between the strip and the layer behind it
TILTS_DEG = (2.5, 5.0, 7.5, 10.0)  # of the bone below a strip that is stored over flat bone


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A medium in cells (depth, across); the strip lies in one row."""

    cell_mm: float
    speed_mm_per_us: Floats  # (nz, nx)
    density_g_per_cm3: Floats  # (nz, nx)
    row: int  # of the strip
    columns: slice  # of the strip


def on_grid(case: Strip, finer: int, depth_mm: float, until_us: float) -> Floats:
    """Return the record (samples,) of a stored strip on a grid with cells that much smaller.

    Args:
        case: The strip and its bone.
        finer: Cells and time steps to one of the stored field; 1 gives that field.
        depth_mm: Of the grid below the strip; the absorbing layer starts there.
        until_us: Length of the record; every stored time step below it is returned.
    """
    cell_mm, strip = case.cell_mm / finer, case.cells * finer
    least = round(2.0 * ASIDE * case.half_mm / cell_mm) + 2 * LAYER_CELLS
    nx = _fast(least)
    while (nx - strip) % 2:
        nx = _fast(nx + 1)
    x = (np.arange(nx, dtype=np.float64) - (nx - 1) / 2.0) * cell_mm
    edges = np.ascontiguousarray(case.edges_mm(x).T)
    samples = len(case.sent) * finer
    sent = np.fft.irfft(np.fft.rfft(case.sent), samples) * finer
    kept = round(until_us / case.step_us)
    cells = rendered(cell_mm, edges, depth_mm, strip, LAYERS)
    return record(cells, case.step_us / finer, sent[: (kept - 1) * finer + 1])[::finer]


def front_on_grid(case: Strip, finer: int) -> Comparison:
    """Return the front echo of the model, boundaries sharp, beside that of a finer grid."""
    until_us = case.front_us[1]
    depth_mm = case.reach_mm + BEHIND_MM
    wave = on_grid(case, finer, depth_mm, until_us)
    model = strip_record(case, exact=True)[: len(wave)]
    return Comparison(case.name, model, wave, case.step_us, case.front_us)


def tilted_front(name: str, tilt_deg: float) -> Comparison | None:
    """Return the front echo of tilted bone, model in the grid's cells beside the grid itself.

    Args:
        name: A stored strip over flat bone, whose pulse and cells are taken.
        tilt_deg: Of the bone.
    """
    flat = stored_strip(name)
    if flat is None:
        return None
    case = replace(flat, name=f"{name}, tilted {tilt_deg:g}", lean_rad=np.deg2rad(tilt_deg))
    wave = on_grid(case, 1, case.reach_mm + BEHIND_MM, case.front_us[1])
    model = strip_record(case, exact=True, cell_mm=case.cell_mm)[: len(wave)]
    return Comparison(case.name, model, wave, case.step_us, case.front_us)


def rendered(
    cell_mm: float, edges_mm: Floats, depth_mm: float, strip: int, layers: tuple[Material, ...]
) -> Cells:
    """Return layers in cells.

    Args:
        cell_mm: Size of a cell.
        edges_mm: Depths of the boundaries under the strip (layers - 1, nx); nx = 1: in 1D.
        depth_mm: Of the grid below the strip, without the absorbing layer.
        strip: Cells of the strip, in the middle of nx.
        layers: From the strip down.
    """
    row, nx = LAYER_CELLS + MARGIN_CELLS, edges_mm.shape[1]
    nz = _fast(row + round(depth_mm / cell_mm) + LAYER_CELLS)
    centres = (np.arange(nz) - row)[:, None] * cell_mm
    stiff = [m.density_g_per_cm3 * m.speed_mm_per_us**2 for m in layers]
    density = np.full((nz, nx), layers[0].density_g_per_cm3)
    softness = np.full((nz, nx), 1.0 / stiff[0])
    for i, edge in enumerate(edges_mm):
        share = np.clip((centres - edge) / cell_mm + 0.5, 0.0, 1.0)
        density += share * (layers[i + 1].density_g_per_cm3 - layers[i].density_g_per_cm3)
        softness += share * (1.0 / stiff[i + 1] - 1.0 / stiff[i])
    first = (nx - strip) // 2
    return Cells(
        cell_mm, 1.0 / np.sqrt(softness * density), density, row, slice(first, first + strip)
    )


def record(cells: Cells, step_us: float, sent: Floats) -> Floats:
    """Return the mean pressure over the strip (samples,) that sends ``sent`` (samples,)."""
    real = np.float32
    shape, dx = cells.density_g_per_cm3.shape, cells.cell_mm
    fastest = float(cells.speed_mm_per_us.max())
    k = [
        2.0 * np.pi * np.fft.fftfreq(shape[0], dx)[:, None],
        2.0 * np.pi * np.fft.rfftfreq(shape[1], dx)[None, :],
    ]
    half = 0.5 * fastest * step_us * np.hypot(*k)
    exact = np.sinc(half / np.pi)
    ahead = [(1j * ki * exact * np.exp(0.5j * ki * dx)).astype(np.complex64) for ki in k]
    back = [(1j * ki * exact * np.exp(-0.5j * ki * dx)).astype(np.complex64) for ki in k]
    fade, fade_between = (_absorbing(shape, fastest * step_us / dx, shift) for shift in (0.0, 0.5))
    light, rho = [], cells.density_g_per_cm3
    for axis in (0, 1):
        beyond = np.take(rho, np.minimum(np.arange(shape[axis]) + 1, shape[axis] - 1), axis)
        light.append((step_us * 2.0 / (rho + beyond)).astype(real))
    dense, square = (step_us * rho).astype(real), (cells.speed_mm_per_us**2).astype(real)
    strip: Floats = np.zeros(shape, dtype=np.float64)
    strip[cells.row, cells.columns] = step_us / (dx * cells.speed_mm_per_us[cells.row, 0])
    pattern = _field(_spectrum(strip) * np.cos(half), shape)
    u, parts = ([np.zeros(shape, np.float32) for _ in k] for _ in range(2))
    pressure: Singles = np.zeros(shape, np.float32)
    heard: list[float] = []
    for loud in sent:
        spectrum = _spectrum(pressure)
        for i in (0, 1):
            slope = _field(ahead[i] * spectrum, shape)
            u[i][:] = fade_between[i] * (fade_between[i] * u[i] - light[i] * slope)
            slope = _field(back[i] * _spectrum(u[i]), shape)
            parts[i][:] = (
                fade[i] * (fade[i] * parts[i] - dense * slope) + np.float32(loud) * pattern
            )
        np.multiply(square, parts[0] + parts[1], out=pressure)
        heard.append(float(np.mean(pressure[cells.row, cells.columns])))
    return np.array(heard, dtype=np.float64)


def _fast(cells: int) -> int:
    """Return the least number of cells, no less than these, that is fast to transform."""
    return int(fft.next_fast_len(cells, real=True) or cells)


def _spectrum(field: Floats | Singles) -> Phasors:
    return np.asarray(fft.rfft2(field), dtype=np.complex64)


def _field(spectrum: Phasors, shape: tuple[int, int]) -> Singles:
    return np.asarray(fft.irfft2(spectrum, shape), dtype=np.float32)


def _absorbing(shape: tuple[int, int], courant: float, shift: float) -> list[Singles]:
    """Return the factors of half a step along either axis, 1 inside the absorbing layer."""
    factors = []
    for axis, n in enumerate(shape):
        at = np.arange(n) + shift
        deep = np.maximum(LAYER_CELLS - at, at - (n - 1 - LAYER_CELLS)) / LAYER_CELLS
        loss = LAYER_NEPER * courant * np.maximum(deep, 0.0) ** 4 if n > 1 else np.zeros(1)
        factor = np.exp(-0.5 * loss).astype(np.float32)
        factors.append(factor[:, None] if axis == 0 else factor[None, :])
    return factors


def main() -> int:
    """Print how well the fields come back, front echoes over smaller cells, and tilted bone."""
    for name in STRIPS:
        case = stored_strip(name)
        if case is None:
            sys.stderr.write(f"no stored field {name}\n")
            return 1
        again = on_grid(case, 1, DEEP_MM, len(case.heard) * case.step_us)
        rest = np.linalg.norm(again - case.heard) / np.linalg.norm(case.heard)
        found = front_on_grid(case, 2)
        level = f"{found.front_db:+.2f} dB, {found.front_ns:+.1f} ns"
        sys.stdout.write(f"{name}: the stored field but for {rest:.0e}; half the size: {level}\n")
        sys.stdout.flush()
    for name in (name for name in STRIPS if "flat" in name):
        for tilt_deg in TILTS_DEG:
            tilted = tilted_front(name, tilt_deg)
            assert tilted is not None  # stored: its flat field was compared
            level = f"{tilted.front_db:+.2f} dB, {tilted.front_ns:+.1f} ns"
            sys.stdout.write(f"{tilted.name} degrees: model in cells over grid {level}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
