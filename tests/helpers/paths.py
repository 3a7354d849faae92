"""Demonstrated paths for the tests: a meander on a sphere, drawn by an unsteady hand."""

import numpy as np

from rona_core.path.simplification.error_bound import deviations, piece_costs


def meander(n, *, lines=9, length_mm=60.0, spacing_mm=5.0, radius_mm=80.0):
    """Return n points (n, 3), evenly spaced along a meander on a sphere."""
    x = np.linspace(-length_mm / 2, length_mm / 2, 121)
    y = (np.arange(lines) - (lines - 1) / 2) * spacing_mm
    corners = np.vstack(
        [np.column_stack((x[:: (-1) ** k], np.full(121, v))) for k, v in enumerate(y)]
    )
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))))
    at = np.linspace(0.0, along[-1], n)
    flat = np.column_stack([np.interp(at, along, column) for column in corners.T])
    return np.column_stack((flat, np.sqrt(radius_mm**2 - (flat**2).sum(axis=1))))


def unsteady(rng, times_s, low_hz, high_hz, rms_mm):
    """Return motion (n, 3) of 40 tones per axis with the given 3D RMS."""
    f, phase = rng.uniform(low_hz, high_hz, (3, 40)), rng.uniform(0, 2 * np.pi, (3, 40))
    v = np.sin(2 * np.pi * f[:, :, None] * times_s + phase[:, :, None]).sum(axis=1).T
    return v * rms_mm / np.sqrt((v**2).sum(axis=1).mean())


def demonstration(rng, n=307, duration_s=35.0):
    """Return samples (n, 3) and times (n,) of a hand with tremor, wander and tracker noise."""
    times = np.linspace(0.0, duration_s, n)
    tremor = unsteady(rng, times, 6.0, 12.0, 0.3)
    wander = unsteady(rng, times, 0.2, 1.5, 1.0)
    noise = rng.normal(0, 0.35 / np.sqrt(3), (n, 3))
    return meander(n) + tremor + wander + noise, times


def piece_cost(piece, metric):
    """Return the deviation of the originals ``piece`` (k, m) from the segment between its ends."""
    ends = np.array([len(piece) - 1])
    return float(piece_costs(np.ascontiguousarray(piece.T), np.zeros_like(ends), ends, metric)[0])


def deviation(path, index, metric):
    """Return one figure of the worst piece: mm for "k1" and "k2", mm^2 for "k3"."""
    found = deviations(path, index)
    return {"k1": found.k1_mm, "k2": found.k2_mm, "k3": found.k3_mm2}[metric]
