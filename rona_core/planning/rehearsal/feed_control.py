"""Feed controlled by force: never faster than planned, slower where the bone is hard."""

from dataclasses import dataclass

from rona_core.planning.rehearsal.site import ForceReading


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """How much force is wanted at most; assumed."""

    most_n: float = 5.0
    least_share: float = 0.25  # of the planned feed, below which nothing is gained
    memory: float = 0.7  # of the force so far, step by step


class FeedControl:
    """Share of the planned feed for the next step."""

    def __init__(self, limits: ForceLimits | None = None) -> None:
        """Begin at the planned feed."""
        self._limits = limits or ForceLimits()
        self.share = 1.0
        self._force_n = 0.0

    def update(self, reading: ForceReading) -> None:
        """Take in the force of a step."""
        limits = self._limits
        self._force_n = limits.memory * self._force_n + (1.0 - limits.memory) * reading.mean_n
        wanted = self.share * limits.most_n / max(self._force_n, 1e-3)
        self.share = min(max(wanted, limits.least_share), 1.0)
