"""Plates of bone as maps with draws, for placements whose answer can be written down."""

import numpy as np
from scipy.stats import norm

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.planning.placement.problem import (
    ExecutionError,
    MappedBone,
    PlacementLimits,
    PlacementProblem,
)

AT: Floats = np.linspace(-20.0, 20.0, 41)
U, V = np.meshgrid(AT, AT, indexing="ij")


def maps_of(outer: Floats, inner: Floats, ok: Bools | None = None) -> Maps:
    ok = np.ones(outer.shape, dtype=np.bool_) if ok is None else ok
    boundaries = [BoundaryMap(Pose.identity(), AT, AT, height, ok) for height in (outer, inner)]
    empty, none = np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    return Maps(empty, empty, none, none, boundaries[0], boundaries[1], boundaries[0], None)


def plate(
    thickness: float = 6.0,
    lean: tuple[float, float] = (0.0, 0.0),
    inner_lean: tuple[float, float] | None = None,
    sigma_mm: float = 0.2,
    ok: Bools | None = None,
    draws: int = 400,
) -> MappedBone:
    """Return a plate that leans, and whose inner boundary is off by one number in each draw."""
    inner_lean = lean if inner_lean is None else inner_lean
    outer = lean[0] * U + lean[1] * V
    inner = inner_lean[0] * U + inner_lean[1] * V - thickness
    quantiles = np.random.default_rng(0).permutation(normal_quantiles(draws))
    off = sigma_mm * quantiles[:, None, None]
    same = np.repeat(outer[None], draws, axis=0)
    return MappedBone(maps_of(outer, inner, ok), same, inner + off)


def normal_quantiles(count: int) -> Floats:
    return np.asarray(norm.ppf((np.arange(count) + 0.5) / count), dtype=np.float64)


def exact_problem(bone: MappedBone, limit_mm: float = 1.0) -> PlacementProblem:
    """Return what is asked of a bed that is milled just as it was planned."""
    return PlacementProblem(bone, ExecutionError(0.0, 0.0), PlacementLimits(limit_mm))
