"""Seat of a bed: the plane z = 0 through the outer boundary at the rim, as a pose in the map."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.mapped_bone import MappedBone

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
