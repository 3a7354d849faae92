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
            return self.value <= bound + slack
        return self.value >= bound - slack

    def as_dict(self) -> dict[str, object]:
        """Return plain values, ready for JSON."""
        return {
            "name": self.name,
            "value": self.value,
            "unit": self.unit,
            "direction": self.direction,
            "goal": self.goal,
            "peer": self.peer,
            "peer_value": self.peer_value,
            "holds": self.holds,
        }


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


def cpu_ms(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the least process CPU time of ``work`` over some repetitions, in milliseconds."""
    times: list[float] = []
    for _ in range(repeats):
        start = process_time()
        work()
        times.append(process_time() - start)
    return 1e3 * min(times)
