"""Messages of the motion planning."""

from dataclasses import MISSING
from typing import Literal

from rona_core.app.messages.message import message
from rona_core.devices import limits
from rona_core.robot.base_placement.reachability import MAX_PLACES, BaseSearch


@message
class TakeMotion:
    """Take the motion that was imported as the plan of the scan, if the verifier certifies it."""


@message
class StartRollSearch:
    """Search the roll about the probe axis that the robot can traverse; plan, time and verify.

    The mode ``auto`` takes a constant roll, and one that varies along the path where none will do.
    """

    n_rolls: int = limits.number(72, "Roll angles", "", 1, 720, 1, hint="Over the range below")
    roll_from_deg: float = limits.number(
        0.0, "From", "deg", -360.0, 720.0, 5.0, hint="First roll angle of the range"
    )
    roll_to_deg: float = limits.number(
        360.0,
        "To",
        "deg",
        -360.0,
        720.0,
        5.0,
        hint="End of the range of roll angles",
        above=("roll_from_deg", 0.1),
    )
    choice: Literal["best", "first"] = limits.choice(
        "best",
        "Select by",
        {"best": "Largest margin", "first": "First feasible (paper)"},
        "Which of the feasible roll angles is planned with",
    )
    mode: Literal["auto", "constant", "variable"] = limits.choice(
        "auto",
        "Roll mode",
        {"auto": "Constant, else varying", "constant": "Constant", "variable": "Varying"},
        "Whether the roll may vary along the path",
    )


@message
class ChooseRoll:
    """Plan and verify the scan with another roll of the search (its index, from 0)."""

    index: int = limits.number(MISSING, "Roll no.", "", 0, 9999, 1, hint="Of the search, from 0")
    branch: int | None = limits.number(
        None,
        "Branch",
        "",
        0,
        7,
        1,
        hint="Ranked for this roll",
        none="that with the largest margin",
    )


@message
class StartBasePlacement:
    """Search places of the robot's base from which the path can be scanned, best and nearest.

    Places are looked at ``step_mm`` apart, up to ``half_x_mm`` and ``half_y_mm`` to either side of
    where the base stands, at heights ``levels_mm`` from there. Rolls and mode are those of the last
    ``StartRollSearch``.
    """

    half_x_mm: float = limits.like(BaseSearch, "half_x_mm")
    half_y_mm: float = limits.like(BaseSearch, "half_y_mm")
    step_mm: float = limits.like(BaseSearch, "step_mm")
    levels_mm: tuple[float, ...] = limits.like(BaseSearch, "levels_mm")

    def __post_init__(self) -> None:
        self.search()  # refuses what cannot be searched

    def search(self) -> BaseSearch:
        """Return where to look.

        Raises:
            InvalidInputError: no such search, or one of too many places.
        """
        wanted = BaseSearch(self.half_x_mm, self.half_y_mm, self.step_mm, self.levels_mm)
        across, along = (2 * int(v / self.step_mm) + 1 for v in (self.half_x_mm, self.half_y_mm))
        places = across * along * len(self.levels_mm)
        limits.require(places <= MAX_PLACES, f"{places} places are too many: at most {MAX_PLACES}")
        return wanted


@message
class ApplyBasePlacement:
    """Move the robot's base to the place found: that with the largest margin, or the nearest.

    The tracker is registered to the base: tool, surface, path and all that follows are then to be
    done again.
    """

    place: Literal["best", "smallest"] = "smallest"
