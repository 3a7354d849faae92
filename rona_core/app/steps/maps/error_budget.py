"""Error budget of the maps: what each cause adds, predicted, beside what it adds in truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.mapping.accuracy.error_terms import CellSigma
from rona_core.mapping.accuracy.map_accuracy import MapAccuracy
from rona_core.mapping.accuracy.map_terms import BETWEEN_PASSES

TIMING = "time of flight"


class Group(NamedTuple):
    """Causes that are one line of a budget."""

    causes: tuple[str, ...]  # as `map_accuracy` names them
    key: str = ""  # the figure that is their truth; such a line is always there
    alike: tuple[str, ...] = ()  # causes of other lines of which this one has what is shared

    @property
    def title(self) -> str:
        """Title of the figure that is their truth, else the cause itself."""
        return FIGURES[self.key].title if self.key else self.causes[0].capitalize()


OUTER = (
    Group(("links of the robot",), "outer_by_links_mm"),
    Group(("head motion",), "outer_by_head_mm"),
    # echoes cannot tell apart what they hold in common
    Group(("mounting of the probe", "delay line", "coupling"), "outer_by_probe_mm", (TIMING,)),
    # nor an echo what it averages of rough bone
    Group(
        (
            TIMING,
            "repeatability of the robot",
            "interpolation",
            "no front echo",
            "roughness within the beam",
        ),
        "outer_by_sampling_mm",
    ),
)
THICKNESS = (
    Group(("speed of sound of the patient",), "thickness_by_speed_mm", (TIMING,)),
    Group(("speed of sound at the place",), "thickness_by_place_mm"),
    Group((TIMING,), "thickness_by_echo_mm"),
    Group(
        ("interpolation", "no inner echo", "roughness within the beam"),
        "thickness_by_interpolation_mm",
    ),
    Group((BETWEEN_PASSES,)),
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
    name: str, part: CellSigma, groups: Sequence[Group], figures: Mapping[str, object]
) -> ErrorBudget:
    moved = {cause for group in groups for cause in group.alike}
    lines: list[BudgetLine] = []
    for group in groups:
        if not group.key and not {*group.causes} & {row.cause for row in part.budget}:
            continue
        own = [row.own_mm for row in part.budget if row.cause in group.causes]
        held = {*group.alike, *group.causes} - (moved - {*group.alike})
        shared = [row.shared_mm for row in part.budget if row.cause in held]
        true = figures.get(group.key)
        known = float(true) if isinstance(true, int | float) else None
        lines.append(BudgetLine(group.title, float(np.hypot.reduce([*own, *shared])), known))
    largest = part.budget[0]
    return ErrorBudget(name, tuple(lines), largest.cause, largest.remedy)
