"""What all motions of the hand are laid out with: directions, and places on the true bone."""

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.virtual.pointer_motion import cross
from rona_core.virtual.scene import VirtualScene

STAND_OFF_MM = 40.0  # from where a place is projected onto the bone
MAX_GAP = 0.05  # share of a stroke that may cross holes of the bone


def lowered(scene: VirtualScene, times: Floats, points: Floats, outward: Floats) -> Floats:
    """Return points (n, 3) of a stroke brought onto the bone along ``-outward`` (n, 3).

    Raises:
        InvalidInputError: more than a twentieth of them miss the bone.
    """
    T_base_skull = scene.T_base_skull
    T_skull_base = T_base_skull.inv()
    starts = points + STAND_OFF_MM * outward
    depths = scene.specimen.ray(T_skull_base @ starts, T_skull_base.rotate(-outward))
    met = np.isfinite(depths) & (np.abs(depths - STAND_OFF_MM) < STAND_OFF_MM)
    if np.count_nonzero(~met) > MAX_GAP * len(met):
        raise InvalidInputError(
            f"{np.mean(~met):.0%} of the stroke lies beyond the specimen or over holes of it: "
            "choose another region or other places"
        )
    depths = np.interp(times, times[met], depths[met])  # the tip passes over a small hole
    return starts - depths[:, None] * outward


def tangents(z: Floats, towards: Floats) -> tuple[Floats, Floats, Floats]:
    """Return right-handed axes (..., 3) with this z, x as near to ``towards`` as that allows."""
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = towards - (towards * z).sum(axis=-1, keepdims=True) * z
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return x, cross(z, x), z


def leaned(z: Floats, x: Floats, y: Floats, lean_rad: Floats) -> Floats:
    """Return z (n, 3) leaned by angles (n, 2) towards x and y, along great circles."""
    angle = np.linalg.norm(lean_rad, axis=1)[:, None]
    direction = lean_rad[:, :1] * x + lean_rad[:, 1:] * y
    return np.cos(angle) * z + np.sinc(angle / np.pi) * direction
