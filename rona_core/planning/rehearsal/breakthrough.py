"""Force on the burr: the feed that it allows, and the probability of a breakthrough.

Breakthrough: the probability that the burr is through the bone, by the force and by the maps. Soft
tissue puts up next to no force (Federspil 2003). How much bone a step takes changes along the way
and from layer to layer, so the force of the last steps is counted per section of chip and feed, and
held against what the same place put up in the layer above. The draws of the maps say what may be
left there; each is weighed by how well the share of the chip that it puts beyond the bone explains
that ratio. Thin places that no draw has are taken into account as well: what is far from all draws
could not be explained by the force else.
"""

from collections import deque

import numpy as np
from scipy.ndimage import uniform_filter

from rona_core.geometry.arrays import Floats
from rona_core.planning.rehearsal.site import ForceReading

# assumed
MOST_N = 5.0  # of cutting force
LEAST_FEED_SHARE = 0.25  # of the planned feed, below which nothing is gained
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
        self.share = min(max(wanted, LEAST_FEED_SHARE), 1.0)


FEED_POWER = 0.5  # of the force, as it is thought to grow with the feed
CELL_MM = 0.5
NEAR = 3  # cells to a side that stand for a place
LEAST_MM2 = 0.05  # a smaller section of chip is no evidence
STEPS = 3  # of the way, that are felt together: more are late, fewer scatter
LEAST_WORK = 0.5  # section times root of the feed, summed over them, or it is no evidence
CHIP_MM = 0.6  # deeper than this in soft tissue, the chip is soft all through
LEAST_SHARE = 0.1  # of the force that stays then
SCATTER = 0.35  # of the logarithm of a ratio in bone: layers, texture, noise
FREEDOM = 4.0  # of Student's t, whose tails leave room for a hard or a soft place
HIDDEN_SHARE = 0.03  # of draws: there the bone is thinner than these say,
HIDDEN_MM = 0.6  # by so much
PAST_MM = 0.05  # beyond the inner boundary, from which on the burr counts as through


class Breakthrough:
    """Force per work over a grid of the bed, and what follows from it step by step."""

    def __init__(self, half_mm: float) -> None:
        """Begin with no force felt; places lie so far to all sides of the bed's middle."""
        self._half = int(np.ceil(half_mm / CELL_MM)) + NEAR
        self._layer = -1
        self._now, self._above, self._above_near = self._nothing(), self._nothing(), self._nothing()
        self._last: deque[tuple[float, float]] = deque(maxlen=STEPS)  # force and work of steps

    def begin_layer(self, layer: int) -> None:
        """Tell that the steps to come belong to a layer; what was cut in the last one is above."""
        if layer == self._layer:
            return
        self._layer = layer
        self._above = np.where(self._now[1] > 0.0, self._now, self._above)
        near = [uniform_filter(one, NEAR, mode="constant") for one in self._above]
        self._above_near, self._now = NEAR**2 * np.array(near), self._nothing()
        self._last.clear()

    def update(
        self,
        reading: ForceReading,
        bottom_bed: Floats,
        area_mm2: float,
        feed_mm_per_s: float,
        left_mm: Floats,
    ) -> float:
        """Return the probability that the burr is through at a step.

        Args:
            reading: Force along the step.
            bottom_bed: Lowest place of the burr (3,), as commanded.
            area_mm2: Section of the chip that it should take.
            feed_mm_per_s: Of the step.
            left_mm: Draws (k,) of the bone left below it, by the maps; negative: through.
        """
        i, j = (np.rint(bottom_bed[:2] / CELL_MM).astype(np.int64) + self._half).tolist()
        step = (reading.mean_n, area_mm2 * feed_mm_per_s**FEED_POWER)
        self._now[:, i, j] += step
        self._last.append(step)
        if left_mm.min() - HIDDEN_MM >= -PAST_MM:
            return 0.0
        left = np.concatenate((left_mm, left_mm - HIDDEN_MM))
        prior = np.repeat((1.0 - HIDDEN_SHARE, HIDDEN_SHARE), len(left_mm)) / len(left_mm)
        through = left < -PAST_MM
        force, done = np.sum(self._last, axis=0)
        force_above, done_above = self._above_near[:, i, j]
        if area_mm2 < LEAST_MM2 or min(done, done_above) < LEAST_WORK or force_above <= 0.0:
            return float(prior[through].sum())
        ratio = max((force / done) / (force_above / done_above), 0.5 * LEAST_SHARE)
        expected = 1.0 - (1.0 - LEAST_SHARE) * np.clip(-left / CHIP_MM, 0.0, 1.0)
        off = (np.log(ratio) - np.log(expected)) / SCATTER
        weights = prior * (1.0 + off**2 / FREEDOM) ** (-(FREEDOM + 1.0) / 2.0)
        return float(weights[through].sum() / weights.sum())

    def _nothing(self) -> Floats:
        """Return force and work (2, n, n) of cells that were not cut."""
        return np.zeros((2, 2 * self._half + 1, 2 * self._half + 1))
