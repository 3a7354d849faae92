"""Statistics of thicknesses without a known truth: mean, and scatter about a robust plane."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.robust import (
    TUKEY_CUTOFF,
    mad_sigma,
    reweighted_least_squares,
    tukey_weights,
)

FAR_MM = 1.0  # from the plane of the others: not the same echo
FAR_SD = 4.0
ROUNDS = 30
FLAT = 1e-6  # width over length below which positions do not determine a slope


@dataclass(frozen=True, slots=True, eq=False)
class ThicknessFigures:
    """Statistics of a survey whose true thickness is not known."""

    n_scans: int
    mean_mm: float | None  # of the scans that are not flagged; None where there are none
    robust_sd_mm: float | None  # about a plane over the positions
    failure_fraction: float  # without thickness, or over 1 mm and 4 robust SD off the plane
    flagged_fraction: float  # without thickness


def thickness_figures(
    thickness_mm: Floats, ok: Bools, positions_mm: Floats | None
) -> ThicknessFigures:
    """Return mean, robust scatter and the share of failures.

    Args:
        thickness_mm: Of each scan (n,).
        ok: Which of them are not flagged (n,).
        positions_mm: Of the scans (n, 1 to 3); None takes a constant in place of a plane.
    """
    n = len(ok)
    flagged = float(1.0 - ok.mean()) if n else 0.0
    if not ok.any():
        return ThicknessFigures(n, None, None, flagged, flagged)
    plane = _robust_plane(thickness_mm, ok, positions_mm)
    residuals = (thickness_mm - plane)[ok]
    sd = mad_sigma(residuals, center=float(np.median(residuals)))
    off = np.abs(residuals) > max(FAR_MM, FAR_SD * sd)
    failures = (float(off.sum()) + float((~ok).sum())) / n
    mean = float(thickness_mm[ok].mean())
    return ThicknessFigures(n, mean, sd, failures, flagged)


def _robust_plane(thickness_mm: Floats, ok: Bools, positions_mm: Floats | None) -> Floats:
    """Return what a robust plane (Tukey's weights from a median start) predicts, (n,)."""
    design = _design(len(ok), ok, positions_mm)
    if design.shape[1] == 1:
        return np.full(len(ok), float(np.median(thickness_mm[ok])))
    used, value = design[ok], thickness_mm[ok]
    # a first plane by least absolute deviations, which a few wrong echoes do not turn
    first = reweighted_least_squares(
        used, value, lambda off: 1.0 / np.maximum(np.abs(off), 1e-3), rounds=ROUNDS
    )

    def biweight(off: Floats) -> Floats:
        return tukey_weights(off, TUKEY_CUTOFF * mad_sigma(off, floor=1e-6))

    plane = reweighted_least_squares(
        used, value, biweight, rounds=ROUNDS, weights=biweight(value - used @ first)
    )
    return np.asarray(design @ plane)


def _design(n: int, ok: Bools, positions_mm: Floats | None) -> Floats:
    """Return a constant and the positions along those axes that they spread over."""
    constant = np.ones((n, 1))
    if positions_mm is None or ok.sum() < 4:
        return constant
    centred = positions_mm - positions_mm[ok].mean(axis=0)
    _, widths, axes = np.linalg.svd(centred[ok], full_matrices=False)
    wide = widths > FLAT * max(float(widths[0]), 1e-9)
    # a plane over a surface: two directions, even where three coordinates were written
    axes = axes[wide][: min(2, int(ok.sum()) - 2)]
    scaled = centred @ axes.T
    return np.column_stack((constant, scaled / np.maximum(np.abs(scaled).max(axis=0), 1e-9)))
