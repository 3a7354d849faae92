"""Radii of the four boundaries of the simulated skull about its centre, in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.virtual.specimen.simulated.spherical_fields import (
    Curves,
    Egg,
    Field,
    Waves,
    chart_directions,
)

FLOOR_MM = 1.3  # bone is never radially thinner than this
FLOOR_WIDTH_MM = 0.4  # over which the floor sets in
SUTURE_CAP_MM = 0.4  # deepest suture; less than the thinnest outer table

DIPLOE_SHARE = (0.30, 0.50)  # of the thickness, in thin and in thick bone
DIPLOE_AT_MM = 4.0  # thickness halfway between the two
DIPLOE_WIDTH_MM = 0.8
OUTER_TABLE_SHARE = 0.55  # of what is not diploe
STEP_REACH = 0.8  # of the thinner layer beside it: so far the step may be off


def diploe_share(thickness_mm: Floats) -> Floats:
    """Return the share of the diploe (n,) in bone of a thickness (n,): narrow in thin bone."""
    low, high = DIPLOE_SHARE
    return low + (high - low) * expit((thickness_mm - DIPLOE_AT_MM) / DIPLOE_WIDTH_MM)


def layer_depths(thickness_mm: Floats, share: Floats) -> Floats:
    """Return the depths (n, 4) of the four boundaries below the outer one."""
    tables = (1.0 - share) * thickness_mm
    outer_table = OUTER_TABLE_SHARE * tables
    inner_table = tables - outer_table
    zero = np.zeros_like(thickness_mm)
    return np.stack((zero, outer_table, thickness_mm - inner_table, thickness_mm), axis=-1)


def move_step(depths: Floats, by_mm: Floats | float) -> None:
    """Move the step from outer table to diploe in depths (n, 4), short of its neighbours."""
    outer, step, table = depths[:, :3].T
    most = STEP_REACH * np.minimum(step - outer, table - step)
    depths[:, 1] += most * np.tanh(by_mm / most)


@dataclass(frozen=True, slots=True, eq=False)
class SkullShape:
    """One simulated head: every boundary is ``|x - center| = radius(direction)``."""

    center_skull: Vector3
    egg: Egg
    relief: tuple[Field, ...]  # added to the egg
    sutures: Curves  # carved into the outer boundary only
    base_thickness_mm: float
    template: tuple[Field, ...]  # added to the base thickness
    diploe: Waves  # shifts where the diploe widens
    texture: tuple[Waves, ...] = ()  # of the outer boundary alone
    step: tuple[Waves, ...] = ()  # of the step from outer table to diploe alone

    def radii(self, u: Floats) -> Floats:
        """Return the radii (n, 4) in mm of the four boundaries, outermost first.

        Args:
            u: Unit directions from the centre, (n, 3).
        """
        return self._radii(lambda field: field.value(u))

    def outer_radii(self, u: Floats) -> Floats:
        """Return the radii (n,) of the outer boundary alone: the first of ``radii``."""

        def value(field: Field) -> Floats:
            return field.value(u)

        return self._uncarved(value) - self._carving(value)

    def chart_radii(self, axes: Floats, slopes: Floats) -> Floats:
        """Return the radii (n n, 4) in mm at ``chart_directions`` of slopes (n,), ascending."""
        u = chart_directions(axes, slopes)

        def value(field: Field) -> Floats:
            waves = isinstance(field, Waves)
            return field.chart_value(axes, slopes) if waves else field.value(u)

        return self._radii(value)

    def _radii(self, value: Callable[[Field], Floats]) -> Floats:
        """Return the radii (n, 4) from what the fields are."""
        wish = self.base_thickness_mm + sum((value(field) for field in self.template), 0.0)
        x = (wish - FLOOR_MM) / FLOOR_WIDTH_MM
        thickness = FLOOR_MM + FLOOR_WIDTH_MM * np.logaddexp(0.0, x)
        depths = layer_depths(thickness, diploe_share(thickness + value(self.diploe)))
        depths[:, 0] = self._carving(value)
        move_step(depths, sum((value(field) for field in self.step), 0.0))
        return self._uncarved(value)[:, None] - depths

    def _uncarved(self, value: Callable[[Field], Floats]) -> Floats:
        """Return the radii (n,) that all depths are counted from."""
        return value(self.egg) + sum((value(field) for field in self.relief), 0.0)

    def _carving(self, value: Callable[[Field], Floats]) -> Floats:
        """Return how deep (n,) sutures and texture are carved into the outer boundary."""
        carved = value(self.sutures) + sum((value(field) for field in self.texture), 0.0)
        return SUTURE_CAP_MM * np.tanh(carved / SUTURE_CAP_MM)
