"""One figure of merit: what was measured, what is aimed at, and what somebody else reaches."""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import process_time
from typing import Literal

Direction = Literal["lower", "higher"]
Progress = Callable[[str], None]

REPEATS = 5
ROUNDING = 1e-9  # of the bound: the same computation in another order is no worse


@dataclass(frozen=True, slots=True)
class Metric:
    """A figure with its unit; None where nothing could be measured."""

    name: str
    value: float | None
    unit: str
    direction: Direction
    goal: float | None = None
    peer: str | None = None
    peer_value: float | None = None

    @property
    def holds(self) -> bool | None:
        """Return whether the goal is met, or without a goal whether the peer is matched.

        None where there is neither.
        """
        bound = self.goal if self.goal is not None else self.peer_value
        if bound is None:
            return None
        if self.value is None or not math.isfinite(self.value):
            return False
        slack = ROUNDING * abs(bound)
        if self.direction == "lower":
            return bool(self.value <= bound + slack)  # of NumPy's numbers it is no plain bool
        return bool(self.value >= bound - slack)

    def as_dict(self) -> dict[str, object]:
        """Return plain values, ready for JSON: numbers that are not finite are null there."""
        return {
            "name": self.name,
            "value": _plain(self.value),
            "unit": self.unit,
            "direction": self.direction,
            "goal": _plain(self.goal),
            "peer": self.peer,
            "peer_value": _plain(self.peer_value),
            "holds": self.holds,
        }


def _plain(value: float | None) -> float | None:
    """Return a number of Python, whoever made it; None for none, and for what is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def over_seeds(
    name: str,
    values: Sequence[float | None],
    unit: str,
    direction: Direction,
    *,
    goal: float | None = None,
    peer: str | None = None,
    peer_value: float | None = None,
) -> list[Metric]:
    """Return median and worst of a figure over several runs; runs without it are left out.

    The goal is one for the median; the worst stands beside it without one.
    """
    known = [value for value in values if value is not None]
    median = statistics.median(known) if known else None
    worst = (max(known) if direction == "lower" else min(known)) if known else None
    return [
        Metric(f"{name} (median)", median, unit, direction, goal, peer, peer_value),
        Metric(f"{name} (worst of {len(known)})", worst, unit, direction),
    ]


def cpu_ms(work: Callable[[], object], repeats: int | None = None) -> float:
    """Return the least process CPU time of ``work`` over some repetitions, in milliseconds.

    Without a number it is repeated ``REPEATS`` times.
    """
    times: list[float] = []
    for _ in range(REPEATS if repeats is None else repeats):
        start = process_time()
        work()
        times.append(process_time() - start)
    return 1e3 * min(times)


def row(*cells: object) -> str:
    """Return one line of a table in Markdown."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"
