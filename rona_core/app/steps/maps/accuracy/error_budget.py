"""Error budget of the maps: what each cause adds, predicted, beside what it adds in truth."""

from collections.abc import Mapping
from dataclasses import dataclass

from rona_core.app.steps.maps.accuracy.error_terms import CellSigma
from rona_core.app.steps.maps.accuracy.map_accuracy import MapAccuracy

# Title, causes as `map_accuracy` names them, and the figure of docs/metrics.md that is their truth:
# echoes cannot tell apart what they hold in common.
Group = tuple[str, tuple[str, ...], str]
OUTER: tuple[Group, ...] = (
    ("Links of the robot", ("links of the robot",), "outer_by_links_mm"),
    ("Head motion", ("head motion",), "outer_by_head_mm"),
    (
        "Probe: mounting, line, coupling",
        ("mounting of the probe", "delay line", "coupling"),
        "outer_by_probe_mm",
    ),
    (
        "Each echo: timing, repeatability",
        ("time of flight", "repeatability of the robot"),
        "outer_by_echo_mm",
    ),
    (
        "Between A-scans and within the beam",
        ("interpolation", "roughness within the beam"),
        "outer_by_interpolation_mm",
    ),
)
THICKNESS: tuple[Group, ...] = (
    ("Speed of sound, patient", ("speed of sound of the patient",), "thickness_by_speed_mm"),
    ("Speed of sound, place", ("speed of sound at the place",), "thickness_by_place_mm"),
    ("Each echo: timing", ("time of flight",), "thickness_by_echo_mm"),
    (
        "Between A-scans and within the beam",
        ("interpolation", "inner boundary not heard", "roughness within the beam"),
        "thickness_by_interpolation_mm",
    ),
)


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """One line of a budget: standard deviation as predicted, and RMS error in truth, in mm."""

    title: str
    predicted_mm: float
    true_mm: float | None  # None where no truth is known


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """The lines of one map, its largest cause, and what would lower that."""

    name: str
    lines: tuple[BudgetLine, ...]
    largest: str
    remedy: str  # empty where nothing is known to


def error_budgets(accuracy: MapAccuracy, figures: Mapping[str, object]) -> tuple[ErrorBudget, ...]:
    """Return the budgets of the outer boundary and of the thickness.

    Args:
        accuracy: Of the maps.
        figures: Of the session, with ground truth where it is known.
    """
    return (
        _budget("Outer boundary", accuracy.outer, OUTER, figures),
        _budget("Thickness", accuracy.thickness, THICKNESS, figures),
    )


def _budget(
    name: str, part: CellSigma, groups: tuple[Group, ...], figures: Mapping[str, object]
) -> ErrorBudget:
    lines: list[BudgetLine] = []
    for title, causes, key in groups:
        squares = [row.sigma_mm**2 for row in part.budget if row.cause in causes]
        true = figures.get(key)
        known = float(true) if isinstance(true, int | float) else None
        lines.append(BudgetLine(title, sum(squares) ** 0.5, known))
    largest = part.budget[0]
    return ErrorBudget(name, tuple(lines), largest.cause, largest.remedy)
