"""Quantities of the virtual world: how each is distributed, in the nominal world and in others.

``docs/world.md`` lists each with its source, and what the algorithms assume in its place. Nothing
here is known to an algorithm.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rona_core.devices.world_settings import WorldProfile


@dataclass(frozen=True, slots=True)
class Uniform:
    """An even distribution from ``low`` to ``high``."""

    low: float
    high: float

    def draw(self, random: np.random.Generator) -> float:
        """Return one value."""
        return float(random.uniform(self.low, self.high))


@dataclass(frozen=True, slots=True)
class Normal:
    """A normal distribution that ends ``most`` standard deviations from its mean."""

    mean: float
    sd: float
    most: float = 2.0

    def draw(self, random: np.random.Generator) -> float:
        """Return one value."""
        return self.mean + self.sd * float(np.clip(random.normal(), -self.most, self.most))


Distribution = Uniform | Normal


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a quantity is in the nominal world, and how it is distributed in the others."""

    nominal: float
    realistic: Distribution
    hard: Distribution

    def draw(self, profile: WorldProfile, random: np.random.Generator) -> float:
        """Return the value for one patient and one set of devices."""
        if profile == "nominal":
            return self.nominal
        return (self.realistic if profile == "realistic" else self.hard).draw(random)


QUANTITIES: Mapping[str, Quantity] = {
    # bone
    "bone_loss": Quantity(1.0, Normal(1.15, 0.22, 2.5), Uniform(1.3, 1.7)),
    "bone_speed": Quantity(1.0, Uniform(0.935, 1.065), Uniform(0.93, 0.96)),
    "outer_texture_mm": Quantity(0.0, Uniform(0.03, 0.15), Uniform(0.12, 0.2)),
    "inner_relief_mm": Quantity(0.0, Uniform(0.05, 0.15), Uniform(0.15, 0.2)),
    "step_relief_mm": Quantity(0.0, Uniform(0.15, 0.4), Uniform(0.4, 0.5)),
    "relief_length_mm": Quantity(5.0, Uniform(2.0, 5.0), Uniform(2.0, 3.0)),
    # coupling
    "gel_speed_mm_per_us": Quantity(1.50, Normal(1.51, 0.02), Uniform(1.53, 1.58)),
    "film_mm": Quantity(0.10, Uniform(0.05, 0.25), Uniform(0.2, 0.4)),
    "friction": Quantity(0.0, Uniform(0.02, 0.15), Uniform(0.1, 0.3)),
    # probe
    "line_excess_k": Quantity(0.0, Uniform(-4.0, 13.0), Uniform(8.0, 13.0)),
    "line_drift_k": Quantity(0.0, Normal(0.7, 0.7), Uniform(2.0, 4.0)),
    "line_strain_share": Quantity(0.0, Normal(0.0, 0.002), Uniform(0.003, 0.006)),
    "pulse_loss": Quantity(0.0, Uniform(0.0, 0.08), Uniform(0.08, 0.15)),
    "mounting_mm": Quantity(0.0, Normal(0.3, 0.1), Uniform(0.5, 0.8)),
    "mounting_deg": Quantity(0.0, Normal(0.5, 0.15), Uniform(0.8, 1.2)),
    # spindle
    "spindle_mm": Quantity(0.0, Normal(0.3, 0.1), Uniform(0.5, 0.8)),
    # devices around
    "robot_mm": Quantity(0.35, Uniform(0.25, 0.5), Uniform(0.5, 0.8)),
    "tracker_share": Quantity(1.0, Uniform(0.5, 1.0), Uniform(1.0, 1.2)),
    # head in its clamp
    "head_drift_mm": Quantity(0.0, Uniform(0.0, 0.3), Uniform(0.3, 0.6)),
    "breathing_mm": Quantity(0.0, Uniform(0.0, 0.05), Uniform(0.05, 0.1)),
}
# share of the patients whose bone is sharp, and hard (``medium.MEDIA``)
BONE_KINDS: Mapping[WorldProfile, tuple[float, float]] = {
    "nominal": (0.0, 0.0),
    "realistic": (0.06, 0.06),
    "hard": (0.3, 0.3),
}
