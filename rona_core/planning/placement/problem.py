"""What a placement has to fulfil: the bone as mapped, the limits, the seat of a bed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from rona_core.devices.limits import require, require_within
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.cell_grid import CellGrid, cosines, refined_field
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.probe_place import SEAT_MM, repeatability_mm
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.path.zones import Zone


@dataclass(frozen=True, slots=True)
class PlacementLimits:
    """What makes a placement safe."""

    residual_mm: float = 1.0  # of bone left below the bed everywhere: a stated choice, no standard
    probability: float = 0.99  # of that, and of enough bone for each screw

    def __post_init__(self) -> None:
        require_within("residual_mm", self.residual_mm, 0.0, 10.0)
        require_within("probability", self.probability, 0.5, 0.9999)


@dataclass(frozen=True, slots=True)
class ExecutionError:
    """Standard deviations of a milled bed against its plan, by the robot that made the maps."""

    depth_mm: float  # along the axis of the bed
    lateral_mm: float  # along each of the two directions across it

    def __post_init__(self) -> None:
        require_within("depth_mm", self.depth_mm, 0.0, 5.0)
        require_within("lateral_mm", self.lateral_mm, 0.0, 5.0)


@dataclass(frozen=True, slots=True)
class SearchGrid:
    """Placements that a search looks at, at every cell of the map."""

    angle_step_deg: float = 15.0  # in the plane of the map
    tilts_deg: tuple[float, ...] = (-3.0, 0.0, 3.0)  # about x and about y of the bed, all pairs

    def __post_init__(self) -> None:
        require_within("angle_step_deg", self.angle_step_deg, 1.0, 180.0)
        require(0.0 in self.tilts_deg, f"tilts_deg must have 0 among them, not {self.tilts_deg}")
        for tilt_deg in self.tilts_deg:
            require_within("tilts_deg", tilt_deg, -15.0, 15.0)

    def angles_rad(self, turn_rad: float) -> Floats:
        """Return the angles (n,) of a bed that looks the same after each turn by ``turn_rad``."""
        count = max(1, int(np.ceil(turn_rad / np.deg2rad(self.angle_step_deg) - 1e-9)))
        return readonly(turn_rad * np.arange(count) / count)

    def tilt_pairs_rad(self) -> Floats:
        """Return the tilts (n, 2) about x and y of the bed."""
        tilts = np.deg2rad(self.tilts_deg)
        return readonly(np.array([(about_x, about_y) for about_x in tilts for about_y in tilts]))


AT_ONCE = 20  # draws that are refined together: all of them take twelve times their own memory


class InnerBoundary:
    """Heights, slopes and draws of the inner boundary over a grid of half the cells of the map.

    Halfway between the cells of the map stands what a cubic through them has; between these it is
    linear. Linear from cell to cell it would cut off crests, where a bed leaves the least bone.

    Attributes:
        grid: Of what follows.
        height_mm: Of the map (cells,).
        slopes: Of the map along u and v (cells, 2).
        cosine: Of a vertical distance to the boundary, what the shortest is (cells,).
        draws_mm: Heights as they may be (cells, draws): those of a place lie side by side.
    """

    def __init__(self, boundary: BoundaryMap, grid: CellGrid, draws_mm: Floats) -> None:
        """Put values between the cells of a map (nu, nv) and of its draws (n, nu, nv)."""
        self.grid = grid.refined()
        height = refined_field(boundary.height_mm, boundary.ok)
        slopes = self.grid.slopes(height)
        self.height_mm: Floats = height.ravel()
        self.slopes: Floats = slopes.reshape(-1, 2)
        self.cosine: Floats = cosines(self.slopes)
        self.draws_mm: Floats = np.zeros((height.size, len(draws_mm)))
        for start in range(0, len(draws_mm), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            finer = refined_field(draws_mm[some], boundary.ok)
            self.draws_mm[:, some] = finer.reshape(len(finer), -1).T

    def draws_at_cells_mm(self) -> Floats:
        """Return the draws at the cells of the map alone (nu nv, draws)."""
        u, v = self.grid.shape
        return self.draws_mm.reshape(u, v, -1)[::2, ::2].reshape((u + 1) // 2 * ((v + 1) // 2), -1)


LEAST_DRAWS = 50  # fewer do not tell the spread of their lower half


class MappedBone:
    """Maps of both boundaries and draws of them, over one grid."""

    def __init__(self, maps: Maps, outer_draws_mm: Floats, inner_draws_mm: Floats) -> None:
        """Look at maps and their draws.

        Args:
            maps: Both boundaries.
            outer_draws_mm: Heights of the outer boundary as they may be (n, nu, nv).
            inner_draws_mm: Heights of the inner boundary in the same draws (n, nu, nv).

        Raises:
            InvalidInputError: the grids do not match, or there are too few draws.
        """
        _check(maps, outer_draws_mm, inner_draws_mm)
        self.outer, self.inner = maps.outer, maps.inner
        self.shape = maps.outer.height_mm.shape
        self.cell_mm = float(maps.outer.u_mm[1] - maps.outer.u_mm[0])
        origin_mm = np.array([maps.outer.u_mm[0], maps.outer.v_mm[0]])
        self.grid = CellGrid(readonly(origin_mm), self.cell_mm, self.shape)
        self.ok: Bools = maps.outer.ok & maps.inner.ok
        self.draws = len(inner_draws_mm)
        self.inner_boundary = InnerBoundary(maps.inner, self.grid, inner_draws_mm)
        padded = np.pad(self.ok, 1)  # beyond the grid nothing is mapped
        self.unmapped_mm = self.cell_mm * np.asarray(distance_transform_edt(padded))[1:-1, 1:-1]
        # a row for each cell: the heights of a place in all draws then lie side by side
        self.outer_draws = np.ascontiguousarray(outer_draws_mm.reshape(self.draws, -1).T)

    def places_mm(self) -> Floats:
        """Return u and v (nu, nv, 2) of every cell."""
        return np.stack(np.meshgrid(self.outer.u_mm, self.outer.v_mm, indexing="ij"), axis=-1)

    def outer_at(self, places_mm: Floats) -> Floats:
        """Return the outer map at places (..., 2), bilinearly."""
        corner, share = self.grid.corners(places_mm)
        u, v, columns = share[..., 0], share[..., 1], self.shape[1]
        first, height = corner[..., 0] * columns + corner[..., 1], self.outer.height_mm.ravel()
        low = (1 - v) * height[first] + v * height[first + 1]
        high = (1 - v) * height[first + columns] + v * height[first + columns + 1]
        return (1 - u) * low + u * high

    def covered(self, places_mm: Floats) -> Bools:
        """Return which places (..., 2) lie among four cells where both boundaries are mapped."""
        corner, share = self.grid.corners(places_mm)
        i, j = np.moveaxis(corner, -1, 0)
        among = self.ok[i, j] & self.ok[i + 1, j] & self.ok[i, j + 1] & self.ok[i + 1, j + 1]
        return among & ((share > -1e-9) & (share < 1.0 + 1e-9)).all(axis=-1)


def _check(maps: Maps, outer_draws_mm: Floats, inner_draws_mm: Floats) -> None:
    shape = maps.outer.height_mm.shape
    require(
        _grid(maps.outer) == _grid(maps.inner),
        f"the outer map has {shape} cells and the inner one {maps.inner.height_mm.shape}, or they "
        "lie elsewhere: make both maps on one grid",
    )
    require(min(shape) >= 3, f"a map of {shape} cells is too small for a bed")
    for name, draws in (("outer", outer_draws_mm), ("inner", inner_draws_mm)):
        require(
            draws.ndim == 3 and draws.shape[1:] == shape,
            f"draws of the {name} map are {draws.shape}, not (n, {shape[0]}, {shape[1]})",
        )
        require(bool(np.isfinite(draws).all()), f"draws of the {name} map must be finite")
    count = len(inner_draws_mm)
    require(
        len(outer_draws_mm) == count,
        f"{len(outer_draws_mm)} draws of the outer map and {count} of the inner one: draw both",
    )
    require(count >= LEAST_DRAWS, f"{count} draws are too few: at least {LEAST_DRAWS} are needed")


def _grid(boundary: BoundaryMap) -> tuple[object, ...]:
    """Return what two maps have in common that lie on one grid."""
    return (
        boundary.u_mm.tolist(),
        boundary.v_mm.tolist(),
        boundary.T_base_map.matrix().tolist(),
        boundary.height_mm.shape,
    )


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


def execution_error(robot: str, tip_sigma_mm: float | None) -> ExecutionError:
    """Return what a bed is off by: the tip of the burr, and what the robot does not repeat.

    Args:
        robot: Its model.
        tip_sigma_mm: 3D standard deviation of the registered tip, as which it counts as known.
            None: without a registration the spindle is clamped by hand, as the probe is, and may
            be off as far as that.
    """
    along_mm = SEAT_MM if tip_sigma_mm is None else tip_sigma_mm / np.sqrt(3.0)
    sigma_mm = float(np.hypot(along_mm, repeatability_mm(robot)))
    return ExecutionError(depth_mm=sigma_mm, lateral_mm=sigma_mm)


ROUNDS = 3  # of laying the plane: the rim moves by less than 0.01 mm in the last


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a bed is laid on the bone."""

    u_mm: float  # of the bed's origin, in the plane of the map
    v_mm: float
    angle_rad: float = 0.0  # of the bed's x axis from that of the map, seen along the map's z
    tilt_x_rad: float = 0.0  # about the bed's x axis, against the plane through the rim
    tilt_y_rad: float = 0.0  # about its y axis


@dataclass(frozen=True, slots=True, eq=False)
class Seats:
    """Frames ``bed`` in ``map`` of k placements, without their tilt, and their rims."""

    rotations: Floats  # (k, 3, 3)
    translations: Floats  # (k, 3)
    rim_mm: Floats  # (k, m) outer boundary over the plane z = 0; positive: bone stands above it


def lay_seats(bone: MappedBone, rim: Floats, places_mm: Floats, angles_rad: Floats) -> Seats:
    """Return the planes that fit the outer map best at the rim of a bed.

    Least squares along the map's z; where the rim meets the plane depends on how the plane leans,
    so it is laid in turns.

    Args:
        bone: With the outer map.
        rim: Outermost places (m, 2) of the bed, in ``bed``.
        places_mm: Of the bed's origin (k, 2) in the plane of the map.
        angles_rad: Of its x axis (k,).
    """
    along = np.stack((np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(angles_rad))), axis=1)
    slopes = np.zeros((len(places_mm), 2))
    heights, rotations = slopes[:, 0], _rotations(slopes, along)
    for _ in range(ROUNDS):
        across = np.swapaxes(rotations[:, :2, :2] @ rim.T, 1, 2)
        surface = bone.outer_at(places_mm[:, None] + across)
        heights, slopes = _planes(across, surface)
        rotations = _rotations(slopes, along)
    across = np.swapaxes(rotations[:, :2, :2] @ rim.T, 1, 2)
    surface = bone.outer_at(places_mm[:, None] + across)
    above = surface - heights[:, None] - (across @ slopes[:, :, None])[..., 0]
    translations = np.column_stack((places_mm, heights))
    return Seats(rotations, translations, above * rotations[:, 2, 2, None])


def tilted(seats: Seats, k: int, placement: Placement) -> Pose:
    """Return the frame ``bed`` of one seat with the tilt of a placement, in ``map``."""
    tilt = Pose.from_rotvec((placement.tilt_x_rad, placement.tilt_y_rad, 0.0))
    return Pose(seats.rotations[k] @ tilt.rotation, seats.translations[k])


def _planes(across: Floats, surface: Floats) -> tuple[Floats, Floats]:
    """Return height at the origin (k,) and slopes (k, 2) of planes through points (k, m)."""
    design = np.concatenate((np.ones((*surface.shape, 1)), across), axis=-1)
    turned = np.swapaxes(design, 1, 2)
    solved = np.linalg.solve(turned @ design, turned @ surface[..., None])
    found = np.asarray(solved[..., 0], dtype=np.float64)
    return found[:, 0], found[:, 1:]


def _rotations(slopes: Floats, along: Floats) -> Floats:
    """Return frames (k, 3, 3): z normal to planes with slopes (k, 2), x over ``along`` (k, 3)."""
    z = np.column_stack((-slopes, np.ones(len(slopes))))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = along.copy()
    x[:, 2] = (slopes * along[:, :2]).sum(axis=1)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack((x, np.cross(z, x), z), axis=-1)
