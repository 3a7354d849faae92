"""The three boundary maps as points with one value each, for drawing."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.steps.maps.map_accuracy import CellSigma, MapAccuracy
from rona_core.geometry.arrays import Floats, readonly
from rona_core.mapping.boundary_map import BoundaryMap, Maps

Quantity = Literal["thickness", "height", "sigma"]
MAPS = ("outer", "inner", "fused")
ROUND_MM = {"thickness": 0.5, "height": 0.5, "sigma": 0.05}  # limits of a scale are multiples


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
    quantity: Quantity
    low_mm: float
    high_mm: float

    def part(self, name: str) -> MapPart:
        """Return one of ``MAPS`` by its name."""
        return {"outer": self.outer, "inner": self.inner, "fused": self.fused}[name]


def layers_of(
    maps: Maps, quantity: Quantity = "thickness", accuracy: MapAccuracy | None = None
) -> MapLayers:
    """Return maps coloured by bone thickness, height over their plane, or standard deviation.

    The last needs how sure the maps are; no cell is shown where nobody knows.
    """
    if quantity == "sigma":
        values_of = [_sigma(maps, name, accuracy) for name in MAPS]
    else:
        values_of = [_values(maps, name, quantity) for name in MAPS]
    parts = [_part(getattr(maps, n), value) for n, value in zip(MAPS, values_of, strict=True)]
    values, step = np.concatenate([part.values_mm for part in parts]), ROUND_MM[quantity]
    low, high = (0.0, 1.0) if not values.size else np.percentile(values, (2.0, 98.0))
    low_mm = float(np.floor(low / step) * step)
    high_mm = float(max(np.ceil(high / step) * step, low_mm + step))
    return MapLayers(parts[0], parts[1], parts[2], quantity, low_mm, high_mm)


def _values(maps: Maps, name: str, quantity: Quantity) -> tuple[Floats, np.ndarray]:
    """Return values and mask over the grid of a map."""
    own: BoundaryMap = getattr(maps, name)
    if quantity == "height":
        return own.height_mm, own.ok
    if own.height_mm.shape != maps.inner.height_mm.shape:
        return own.height_mm, np.zeros_like(own.ok)
    outer = own if name == "fused" else maps.outer
    return outer.height_mm - maps.inner.height_mm, own.ok & maps.inner.ok


def _sigma(maps: Maps, name: str, accuracy: MapAccuracy | None) -> tuple[Floats, np.ndarray]:
    """Return the standard deviations of a map's heights and the mask of what is known."""
    own: BoundaryMap = getattr(maps, name)
    if accuracy is None:
        return own.height_mm, np.zeros_like(own.ok)
    stated: CellSigma = getattr(accuracy, name)
    return stated.total_mm(), own.ok & np.isfinite(stated.own_mm)


def _part(boundary: BoundaryMap, values: tuple[Floats, np.ndarray]) -> MapPart:
    value, mask = values
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    points_map = np.stack((u[mask], v[mask], boundary.height_mm[mask]), axis=1)
    step = float(boundary.u_mm[1] - boundary.u_mm[0]) if len(boundary.u_mm) > 1 else 1.0
    return MapPart(
        readonly(boundary.T_base_map @ points_map), readonly(np.array(value[mask])), step
    )
