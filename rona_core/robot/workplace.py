"""Where work is done in front of an arm: the place of the head, and of the tool's own motion."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Workplace:
    """Places in ``base`` that suit the reach of an arm; the base stands at its default place."""

    region_base: tuple[float, float, float] = (600.0, 60.0, 400.0)  # centre of what is scanned
    pivot_base: tuple[float, float, float] = (560.0, -50.0, 560.0)  # clear of the head
    facing_base: tuple[float, float, float] = (0.866, 0.5, 0.0)  # of the marker plate meanwhile
