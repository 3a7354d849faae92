"""What a placement has to fulfil: the bone, the limits, the errors of milling and the zones."""

from collections.abc import Sequence

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.path.zones import Zone
from rona_core.planning.placement.mapped_bone import MappedBone
from rona_core.planning.placement.settings import ExecutionError, PlacementLimits


class PlacementProblem:
    """Bone, limits, errors of execution and zones, with what all placements share."""

    def __init__(
        self,
        bone: MappedBone,
        execution: ExecutionError,
        limits: PlacementLimits | None = None,
        zones: Sequence[Zone] = (),
    ) -> None:
        """Prepare for many placements.

        Args:
            bone: As mapped and as drawn.
            execution: How well a bed is milled.
            limits: What is safe.
            zones: That the bed and its screws keep away from.
        """
        self.bone, self.execution = bone, execution
        self.limits = limits or PlacementLimits()
        self.zones = tuple(zones)
        # One draw of the milled bed to each draw of the bone, the same for all placements: two of
        # them differ by where they lie, not by luck. Mean and covariance are exact, because what
        # is left to luck in one set of draws would be the same error everywhere.
        lateral, depth = execution.lateral_mm, execution.depth_mm
        normal = np.random.default_rng(0).standard_normal((3, bone.draws))
        normal -= normal.mean(axis=1, keepdims=True)
        normal = np.linalg.solve(np.linalg.cholesky(np.cov(normal)), normal)
        self.errors_bed = normal * np.array([[lateral], [lateral], [depth]])

    def zone_clearance_mm(self, places_mm: Floats) -> Floats:
        """Return by how much places (n, 2) are farther from all zones than they have to be."""
        clearance = np.full(len(places_mm), np.inf)
        for zone in self.zones:
            clearance = np.minimum(clearance, zone.distances_mm(places_mm) - zone.distance_mm)
        return clearance
