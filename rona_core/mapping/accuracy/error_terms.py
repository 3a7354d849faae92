"""Causes of the errors of a map, and the standard deviation that each of them adds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from rona_core.geometry.arrays import Bools, Floats, readonly

# Grooves or crests are where a Gaussian field is more than so many deviations high, as deep as it
# exceeds that: one place in four has some.
HIDDEN_FROM = 0.7
_ABOVE = float(ndtr(-HIDDEN_FROM))  # share of places, and density at the edge
_EDGE = float(np.exp(-0.5 * HIDDEN_FROM**2) / np.sqrt(2.0 * np.pi))
_MEAN = _EDGE - HIDDEN_FROM * _ABOVE
_RMS = float(np.sqrt((1.0 + HIDDEN_FROM**2) * _ABOVE - HIDDEN_FROM * _EDGE))
HIDDEN_ALIKE = _MEAN / _RMS  # share of their RMS that all cells have in common


def hidden_depths(field: Floats) -> Floats:
    """Return depths, all of one sign and of RMS 1, of what a Gaussian field of variance 1 hides."""
    return np.maximum(field - HIDDEN_FROM, 0.0) / _RMS


@dataclass(frozen=True, slots=True, eq=False)
class ErrorTerm:
    """One cause of errors of a map, over its grid (nu, nv) or the same in all cells, in mm."""

    cause: str
    own_mm: Floats | float = 0.0  # standard deviation of what each cell has for itself
    shared_mm: Floats | float = 0.0  # and of one error that all cells have in common
    of_robot: bool = False  # drops out where the robot that scanned uses the map
    remedy: str = ""  # what would lower it
    reach_mm: float = 0.0  # cells so far apart (a Gaussian's deviation) still err alike by ``own``
    hidden: bool = False  # grooves or crests in some of the cells, see `hidden_depths`


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """One cause in an error budget: RMS of its standard deviations over the mapped cells, in mm."""

    cause: str
    own_mm: float
    shared_mm: float
    of_robot: bool
    remedy: str

    @property
    def sigma_mm(self) -> float:
        """Both parts together."""
        return float(np.hypot(self.own_mm, self.shared_mm))


@dataclass(frozen=True, slots=True, eq=False)
class CellSigma:
    """Standard deviations of a height or a thickness over the grid of a map, by who shares them."""

    own_mm: Floats  # (nu, nv) of what each cell has for itself, the robot's part aside
    shared_mm: Floats  # (nu, nv) of what all cells have in common, the robot's part aside
    robot_own_mm: Floats  # (nu, nv) by the robot's links, what is left of it for each cell
    robot_shared_mm: Floats  # (nu, nv) and what all cells have in common of it
    budget: tuple[BudgetRow, ...]  # by cause, largest first

    def same_robot_mm(self) -> Floats:
        """Return the standard deviation (nu, nv) where the robot that scanned uses the map."""
        return np.hypot(self.own_mm, self.shared_mm)

    def total_mm(self) -> Floats:
        """Return the standard deviation (nu, nv), all parts together."""
        return np.hypot(self.same_robot_mm(), np.hypot(self.robot_own_mm, self.robot_shared_mm))

    def whole_own_mm(self) -> Floats:
        """Return the standard deviation (nu, nv) of what each cell has for itself."""
        return np.hypot(self.own_mm, self.robot_own_mm)

    def whole_shared_mm(self) -> Floats:
        """Return the standard deviation (nu, nv) of what all cells have in common."""
        return np.hypot(self.shared_mm, self.robot_shared_mm)


def summed(terms: Sequence[ErrorTerm], ok: Bools) -> CellSigma:
    """Return what the terms make together, squares added; the budget counts cells (nu, nv)."""

    def together(of_robot: bool, part: str) -> Floats:
        squares = np.zeros(ok.shape)
        for term in terms:
            if term.of_robot == of_robot:
                squares = squares + np.square(getattr(term, part))
        return readonly(np.sqrt(squares))

    rows = [
        BudgetRow(
            term.cause,
            _rms(term.own_mm, ok),
            _rms(term.shared_mm, ok),
            term.of_robot,
            term.remedy,
        )
        for term in terms
    ]
    return CellSigma(
        own_mm=together(False, "own_mm"),
        shared_mm=together(False, "shared_mm"),
        robot_own_mm=together(True, "own_mm"),
        robot_shared_mm=together(True, "shared_mm"),
        budget=tuple(sorted(rows, key=lambda row: -row.sigma_mm)),
    )


def _rms(values: Floats | float, ok: Bools) -> float:
    chosen = np.broadcast_to(values, ok.shape)[ok]
    return float(np.sqrt(np.mean(np.square(chosen)))) if len(chosen) else 0.0
