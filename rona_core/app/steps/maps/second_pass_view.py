"""The second pass for the eye: its path and lean, what it is worth, and which cells are its own."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.dependencies.staleness import digest_of, stale_reason
from rona_core.app.steps.maps.derivation import usable_second
from rona_core.app.steps.roll.plan_reasons import why_no_plan
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.mapping.build_maps import NEAR_MM
from rona_core.session.document import Session


@dataclass(frozen=True, slots=True, eq=False)
class SecondView:
    """The planned second pass, in ``base``."""

    points_base: Floats  # (n, 3)
    axes_base: Floats  # (n, 3) of the probe, into the bone
    lean_deg: Floats  # (n,)
    length_mm: float
    duration_s: float | None  # None: the robot cannot follow it
    gap_cells: int
    gap_share: float
    blocked: str | None  # why it cannot be scanned
    stale: str | None


def second_view(session: Session) -> SecondView | None:
    """Return the second pass as it is planned; None before."""
    derived = session.results.second
    if derived is None:
        return None
    way, plan = derived.value.way, derived.value.plan
    motion = plan.trajectory
    return SecondView(
        points_base=way.path.points_base,
        axes_base=way.path.axes_base,
        lean_deg=way.lean_deg,
        length_mm=float(way.path.arc_length_mm()[-1]),
        duration_s=None if motion is None else float(motion.times_s[-1]),
        gap_cells=way.gap_cells,
        gap_share=way.gap_share,
        blocked=why_no_plan(plan),
        stale=stale_reason("second", session),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SecondCells:
    """What the second pass brought to the inner map."""

    points_base: Floats  # (n, 3) cells of the inner map that only it saw
    before: float  # share of the outer map with an inner boundary, without those cells
    after: float  # and with them


def second_cells(session: Session) -> SecondCells | None:
    """Return which cells of the inner map come from the second pass; None without one in it."""
    derived, first = session.results.maps, session.results.detection
    if derived is None or first is None or usable_second(session) is None:
        return None
    maps, n = derived.value, len(first.value)
    of_it = derived.inputs.get("second") == digest_of(session.captures.second)
    if len(maps.inner_points_base) <= n or not of_it:
        return None
    into_map = maps.inner.T_base_map.inv()
    seen = maps.inner_used.copy()
    seen[n:] = False
    cells = maps.inner.points_base()
    places = (into_map @ cells)[:, :2]
    alone = _far_from(places, (into_map @ maps.inner_points_base[seen])[:, :2])
    total = max(int(maps.outer.ok.sum()), 1)
    both = int((maps.outer.ok & maps.inner.ok).sum())
    return SecondCells(
        points_base=readonly(cells[alone]),
        before=(both - int(alone.sum())) / total,
        after=both / total,
    )


def _far_from(places: Floats, samples: Floats) -> Bools:
    """Return which places (n, 2) have no sample (m, 2) so close that it maps them."""
    if not len(samples):
        return np.ones(len(places), dtype=np.bool_)
    return np.asarray(KDTree(samples).query(places)[0] > NEAR_MM)
