"""Messages of the motion planning."""

from typing import Literal

from rona_core.app.messages.message import message, within
from rona_core.devices.limits import like, require
from rona_core.robot.base_placement.candidates import MAX_PLACES, BaseSearch

FIRST_BELOW_LAST = "`roll_from_deg` lies below `roll_to_deg`"


@message
class StartRollSearch:
    """Search the roll about the probe axis that the robot can traverse; plan, time and verify.

    The mode ``auto`` takes a constant roll, and one that varies along the path where none will do.
    """

    n_rolls: int = within(1, 720, default=72)
    roll_from_deg: float = within(-360.0, 720.0, default=0.0, rule=FIRST_BELOW_LAST)
    roll_to_deg: float = within(-360.0, 720.0, default=360.0, rule=FIRST_BELOW_LAST)
    choice: Literal["best", "first"] = "best"
    mode: Literal["auto", "constant", "variable"] = "auto"

    def __post_init__(self) -> None:
        require(
            self.roll_from_deg < self.roll_to_deg,
            f"roll_from_deg {self.roll_from_deg:g} must lie below roll_to_deg {self.roll_to_deg:g}",
        )


@message
class ChooseRoll:
    """Plan and verify the scan with another roll of the search (its index, from 0)."""

    index: int = within(0, 9999)
    # one that is ranked for this roll; None: that with the largest margin
    branch: int | None = within(0, 7, default=None)


@message
class StartBasePlacement:
    """Search places of the robot's base from which the path can be scanned, best and nearest.

    Places are looked at ``step_mm`` apart, up to ``half_x_mm`` and ``half_y_mm`` to either side of
    where the base stands, at heights ``levels_mm`` from there. Rolls and mode are those of the last
    ``StartRollSearch``.
    """

    half_x_mm: float = like(BaseSearch, "half_x_mm")
    half_y_mm: float = like(BaseSearch, "half_y_mm")
    step_mm: float = like(BaseSearch, "step_mm")
    levels_mm: tuple[float, ...] = like(BaseSearch, "levels_mm")

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
        require(places <= MAX_PLACES, f"{places} places are too many: at most {MAX_PLACES}")
        return wanted


@message
class ApplyBasePlacement:
    """Move the robot's base to the place found: that with the largest margin, or the nearest.

    The tracker is registered to the base: tool, surface, path and all that follows are then to be
    done again.
    """

    place: Literal["best", "smallest"] = "smallest"
