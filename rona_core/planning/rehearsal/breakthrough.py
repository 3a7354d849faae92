"""Breakthrough, felt by the force: on the dura its mean and its sigma fall together.

Federspil 2003 saw the sigma of the force fall to about 0 N on the dura. How much bone a step takes
changes along the way, so both are counted per section of chip that the step should take, and held
against what the layer above put up at the same place.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from rona_core.geometry.arrays import Floats
from rona_core.planning.rehearsal.site import ForceReading

FEED_POWER = 0.5  # of the force, as it is thought to grow with the feed
CELL_MM = 1.0
NEAR = 3  # cells to a side that stand for the layer above a place
LEAST_WORK = 0.2  # done in them, or they tell nothing: section times root of the feed


@dataclass(frozen=True, slots=True)
class BreakthroughSettings:
    """When the force says that the burr is through; tuned on rehearsals, see the docs."""

    recent: int = 8  # steps of the way that are held against those before
    gap: int = 8  # steps between both, in which the burr may already be going through
    before: int = 60
    mean_share: float = 0.4  # of what it was before, below which the force has fallen
    sigma_share: float = 1.0  # and its sigma
    least_mm2: float = 0.3  # a smaller section of chip tells nothing,
    most_mm2: float = 1.0  # nor does one of a burr that goes straight into the bone


class Breakthrough:
    """Watches the force step by step, with the burr that mills the floor."""

    def __init__(self, half_mm: float, settings: BreakthroughSettings | None = None) -> None:
        """Begin with no force felt; places lie so far to all sides of the bed's middle."""
        self._settings = settings or BreakthroughSettings()
        self._half = int(np.ceil(half_mm / CELL_MM)) + 1
        self._layer = -1
        self._felt = self._above = self._nothing()
        kept = self._settings.recent + self._settings.gap + self._settings.before
        self._steps: deque[tuple[float, float, float, float]] = deque(maxlen=kept)

    def begin_layer(self, layer: int) -> None:
        """Tell that the steps to come belong to a layer."""
        if layer != self._layer:
            self._layer, felt = layer, self._felt
            near = [uniform_filter(one, NEAR, mode="constant") for one in felt]
            self._above = NEAR**2 * np.array(near)
            self._felt = self._nothing()

    def update(
        self, reading: ForceReading, bottom_bed: Floats, area_mm2: float, feed_mm_per_s: float
    ) -> bool:
        """Return whether the burr is through, by this step and those before it.

        Args:
            reading: Force along the step.
            bottom_bed: Lowest place of the burr (3,), as commanded.
            area_mm2: Section of the chip that it should take.
            feed_mm_per_s: Of the step.
        """
        settings, work = self._settings, area_mm2 * feed_mm_per_s**FEED_POWER
        i, j = (np.rint(bottom_bed[:2] / CELL_MM).astype(np.int64) + self._half).tolist()
        self._felt[:, i, j] += (reading.mean_n, reading.sigma_n, work)
        mean_n, sigma_n, done = self._above[:, i, j].tolist()
        if not settings.least_mm2 <= area_mm2 <= settings.most_mm2:
            return False
        if done < LEAST_WORK or mean_n <= 0.0:
            return False
        expected = work / done
        self._steps.append((reading.mean_n, reading.sigma_n, mean_n * expected, sigma_n * expected))
        if len(self._steps) < settings.recent + settings.gap + settings.before // 2:
            return False
        steps = np.array(self._steps)
        late = steps[-settings.recent :].sum(axis=0)
        early = steps[: -settings.recent - settings.gap].sum(axis=0)
        shares = np.array((settings.mean_share, settings.sigma_share))
        return bool((late[:2] * early[2:] < shares * early[:2] * late[2:]).all())

    def _nothing(self) -> Floats:
        return np.zeros((3, 2 * self._half + 1, 2 * self._half + 1))
