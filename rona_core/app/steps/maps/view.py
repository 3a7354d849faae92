"""The three boundary maps as points with one value each, for drawing."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.dependencies.staleness import made_of, stale_reason
from rona_core.app.steps.maps.further_passes import judge_plan
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.mapping.accuracy.map_accuracy import CellSigma, MapAccuracy
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.session.document import Session

MapQuantity = Literal[
    "thickness",
    "height",
    "sigma",
    "sigma_own",
    "sigma_common",
    "sigma_thickness",
    "error",
    "error_thickness",
]
MAPS = ("outer", "inner", "fused")
ROUND_MM, ROUND_SIGMA_MM = 0.5, 0.05  # limits of a scale are multiples


@dataclass(frozen=True, slots=True, eq=False)
class MapPart:
    """The mapped cells of one map: places (n, 3) in ``base`` and a value (n,) in mm for each."""

    points_base: Floats
    values_mm: Floats
    cell_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class MapLayers:
    """All three maps on one colour scale."""

    outer: MapPart
    inner: MapPart
    fused: MapPart
    quantity: MapQuantity
    low_mm: float
    high_mm: float

    def part(self, name: str) -> MapPart:
        """Return one of ``MAPS`` by its name."""
        return {"outer": self.outer, "inner": self.inner, "fused": self.fused}[name]


def layers_of(
    maps: Maps,
    quantity: MapQuantity = "thickness",
    accuracy: MapAccuracy | None = None,
    errors: MapErrors | None = None,
) -> MapLayers:
    """Return maps coloured by bone thickness, height over their plane, deviation or error.

    A standard deviation of a boundary (all of it, what each cell has for itself, what all cells
    have in common) or of the thickness needs how sure the maps are, an error those against a
    reference, and its scale has 0 in its middle. No cell is shown where the value is unknown.
    """
    of_sigma = quantity.startswith("sigma")
    if quantity.startswith("error"):
        values_of = [_errors(maps, name, quantity, errors) for name in MAPS]
    elif of_sigma:
        values_of = [_sigma(maps, name, quantity, accuracy) for name in MAPS]
    else:
        values_of = [_values(maps, name, quantity) for name in MAPS]
    parts = [_part(getattr(maps, n), value) for n, value in zip(MAPS, values_of, strict=True)]
    values = np.concatenate([part.values_mm for part in parts])
    if quantity.startswith("error"):
        most = float(np.percentile(np.abs(values), 98.0)) if values.size else 1.0
        most_mm = max(1.0, np.ceil(most / ROUND_SIGMA_MM)) * ROUND_SIGMA_MM
        return MapLayers(parts[0], parts[1], parts[2], quantity, -most_mm, most_mm)
    low_mm, high_mm = scale_limits_mm(values, ROUND_SIGMA_MM if of_sigma else ROUND_MM)
    return MapLayers(parts[0], parts[1], parts[2], quantity, low_mm, high_mm)


def scale_limits_mm(values_mm: Floats, step_mm: float) -> tuple[float, float]:
    """Return the ends of a colour scale for values (n,): multiples of a step."""
    low, high = (0.0, 1.0) if not values_mm.size else np.percentile(values_mm, (2.0, 98.0))
    low_mm = float(np.floor(low / step_mm) * step_mm)
    return low_mm, float(max(np.ceil(high / step_mm) * step_mm, low_mm + step_mm))


def _values(maps: Maps, name: str, quantity: MapQuantity) -> tuple[Floats, np.ndarray]:
    """Return values and mask over the grid of a map."""
    own: BoundaryMap = getattr(maps, name)
    if quantity == "height":
        return own.height_mm, own.ok
    if own.height_mm.shape != maps.inner.height_mm.shape:
        return own.height_mm, np.zeros_like(own.ok)
    outer = own if name == "fused" else maps.outer
    return outer.height_mm - maps.inner.height_mm, own.ok & maps.inner.ok


def _sigma(
    maps: Maps, name: str, quantity: MapQuantity, accuracy: MapAccuracy | None
) -> tuple[Floats, np.ndarray]:
    """Return the standard deviations over the grid of a map and the mask of what is known."""
    own: BoundaryMap = getattr(maps, name)
    if accuracy is None:
        return own.height_mm, np.zeros_like(own.ok)
    stated: CellSigma = getattr(accuracy, name)
    if quantity == "sigma_thickness":
        stated = accuracy.thickness
        return stated.total_mm(), own.ok & maps.inner.ok & np.isfinite(stated.own_mm)
    values = {
        "sigma": stated.total_mm,
        "sigma_own": stated.whole_own_mm,
        "sigma_common": stated.whole_shared_mm,
    }[quantity]()
    return values, own.ok & np.isfinite(values)


def _errors(
    maps: Maps, name: str, quantity: MapQuantity, errors: MapErrors | None
) -> tuple[Floats, np.ndarray]:
    """Return the errors over the grid of a map and the mask of what is known."""
    own: BoundaryMap = getattr(maps, name)
    key = "thickness" if quantity == "error_thickness" else name
    values = None if errors is None else errors.errors_mm.get(key)
    if values is None or values.shape != own.ok.shape:
        return own.height_mm, np.zeros_like(own.ok)
    return values, own.ok & np.isfinite(values)


def _part(boundary: BoundaryMap, values: tuple[Floats, np.ndarray]) -> MapPart:
    value, mask = values
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    points_map = np.stack((u[mask], v[mask], boundary.height_mm[mask]), axis=1)
    step = float(boundary.u_mm[1] - boundary.u_mm[0]) if len(boundary.u_mm) > 1 else 1.0
    return MapPart(
        readonly(boundary.T_base_map @ points_map), readonly(np.array(value[mask])), step
    )


@dataclass(frozen=True, slots=True, eq=False)
class SecondView:
    """The planned passes with the probe tilted: the next of them, or the last, in ``base``."""

    points_base: Floats  # (n, 3)
    axes_base: Floats  # (n, 3) of the probe, into the bone
    lean_deg: Floats  # (n,)
    length_mm: float
    duration_s: float | None  # of all passes; None: the robot cannot follow one of them
    count: int  # passes that are planned
    done: int  # and of those, scanned to the end
    blocked: str | None  # why they cannot be scanned
    stale: str | None

    @property
    def scanned(self) -> bool:
        """Whether the robot has scanned all of them."""
        return self.done == self.count


def second_view(session: Session) -> SecondView | None:
    """Return the further passes as they are planned; None before."""
    derived = session.results.second
    if derived is None:
        return None
    planned, held = derived.value, usable_second(session)
    shown = planned.next_pass(held) or planned.passes[-1]
    motions = [one.plan.trajectory for one in planned.passes]
    judged = judge_plan(planned, session)
    return SecondView(
        points_base=shown.way.path.points_base,
        axes_base=shown.way.path.axes_base,
        lean_deg=shown.way.lean_deg,
        length_mm=float(shown.way.path.arc_length_mm()[-1]),
        duration_s=None
        if None in motions
        else sum(float(motion.times_s[-1]) for motion in motions if motion is not None),
        count=len(planned.passes),
        done=planned.scanned(held),
        blocked=None if judged.holds else judged.reason,
        stale=stale_reason("second", session),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SecondCells:
    """What the further passes brought to the inner map."""

    points_base: Floats  # (n, 3) cells of the inner map that only they saw
    before: float  # share of the outer map with an inner boundary, without those cells
    after: float  # and with them


def second_cells(session: Session) -> SecondCells | None:
    """Return which cells of the inner map come from further passes; None without one in it."""
    derived, first = session.results.maps, session.results.detection
    if derived is None or first is None or not usable_second(session):
        return None
    maps, n = derived.value, len(first.value)
    of_it = made_of(derived, "second", session.captures.second)
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
