"""Sphere tracing: first entry of rays into a body of bounded distance."""

from collections.abc import Callable

import numpy as np

from rona_core.geometry.arrays import Floats, Ints

STEEPNESS = 1.4  # how fast a gap may shrink for each millimetre along a ray
LEAST_STEP_MM = 0.15  # a ray that dips in for less than this may be taken for a miss
ROOT_STEPS = 60
ROOT_MM = 1e-9

Gap = Callable[[Floats, Ints], Floats]  # distances t (m,) on rays number i (m,) -> gaps (m,) in mm


def first_entries(
    gap: Gap, starts_mm: Floats, ends_mm: Floats, steepness: float = STEEPNESS
) -> Floats:
    """Return the distance (n,) at which each ray first has a gap of 0 or less.

    Args:
        gap: Positive outside; shrinks by at most ``steepness`` for each millimetre.
        starts_mm: Where each ray begins to look (n,).
        ends_mm: Where it gives up (n,); below the start where the ray cannot hit.
        steepness: See ``gap``.

    Returns:
        Distances, inf where there is no entry; the start itself where the ray begins inside.
    """
    found = np.full(len(starts_mm), np.inf)
    rays = np.flatnonzero(starts_mm <= ends_mm)
    t = starts_mm[rays]
    g = gap(t, rays)
    found[rays[g <= 0.0]] = t[g <= 0.0]
    rays, t, g = rays[g > 0.0], t[g > 0.0], g[g > 0.0]
    brackets: list[tuple[Ints, Floats, Floats, Floats, Floats]] = []
    while len(rays):
        t_next = t + g / steepness + LEAST_STEP_MM
        g_next = gap(t_next, rays)
        hit = g_next <= 0.0
        if hit.any():
            brackets.append((rays[hit], t[hit], t_next[hit], g[hit], g_next[hit]))
        on = ~hit & (t_next <= ends_mm[rays])
        rays, t, g = rays[on], t_next[on], g_next[on]
    if brackets:
        i, low, high, g_low, g_high = (np.concatenate(part) for part in zip(*brackets, strict=True))
        found[i] = find_roots(gap, i, low, high, g_low, g_high)
    return found


def find_roots(
    gap: Gap, rays: Ints, low: Floats, high: Floats, g_low: Floats, g_high: Floats
) -> Floats:
    """Return where the gaps change sign between ``low`` and ``high`` (Illinois method)."""
    a, b, ga, gb = low.copy(), high.copy(), g_low.copy(), g_high.copy()
    root = b.copy()
    busy = np.flatnonzero(np.abs(gb) > ROOT_MM)
    for _ in range(ROOT_STEPS):
        if not len(busy):
            break
        x = b[busy] - gb[busy] * (b[busy] - a[busy]) / (gb[busy] - ga[busy])
        g = gap(x, rays[busy])
        root[busy] = x
        crossed = np.sign(g) != np.sign(gb[busy])
        a[busy] = np.where(crossed, b[busy], a[busy])
        ga[busy] = np.where(crossed, gb[busy], 0.5 * ga[busy])
        b[busy], gb[busy] = x, g
        busy = busy[(np.abs(g) > ROOT_MM) & (np.abs(b[busy] - a[busy]) > ROOT_MM)]
    return root


def sphere_span(origins: Floats, directions: Floats, radius: float) -> tuple[Floats, Floats]:
    """Return where rays (n, 3) enter and leave a sphere about 0; they leave at -1 if they miss."""
    middle = -np.einsum("ij,ij->i", origins, directions)
    square = middle**2 - np.einsum("ij,ij->i", origins, origins) + radius**2
    half = np.sqrt(np.maximum(square, 0.0))
    enter = np.maximum(middle - half, 0.0)
    return enter, np.where(square > 0.0, middle + half, -1.0)
