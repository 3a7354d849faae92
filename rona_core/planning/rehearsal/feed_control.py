"""Feed controlled by force: never faster than planned, slower where the bone is hard."""

from rona_core.planning.rehearsal.site import ForceReading

# assumed
MOST_N = 5.0  # of cutting force
LEAST_SHARE = 0.25  # of the planned feed, below which nothing is gained
MEMORY = 0.7  # of the force so far, step by step


class FeedControl:
    """Share of the planned feed for the next step."""

    def __init__(self) -> None:
        """Begin at the planned feed."""
        self.share = 1.0
        self._force_n = 0.0

    def update(self, reading: ForceReading) -> None:
        """Take in the force of a step."""
        self._force_n = MEMORY * self._force_n + (1.0 - MEMORY) * reading.mean_n
        wanted = self.share * MOST_N / max(self._force_n, 1e-3)
        self.share = min(max(wanted, LEAST_SHARE), 1.0)
