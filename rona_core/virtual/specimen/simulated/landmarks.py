"""Landmarks of the skull: millimetres behind and above the ear canal.

Frame ``skull``: origin midway between the ear canals, x right, y forward, z up.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.virtual.specimen.simulated.spherical_fields import HEAD_MM, Egg

CENTER_SKULL = (0.0, -6.0, 48.0)  # from where the head is seen as a function of direction
BISECTIONS = 40

Place = tuple[float, float]  # mm behind, mm above the ear canal


def direction_of(egg: Egg, place: Place, side: int) -> Vector3:
    """Return the unit direction (3,) from the centre to a place on the egg.

    Args:
        egg: The egg of the head.
        place: Millimetres behind and above the ear canal.
        side: +1 right, -1 left, 0 in the midline.
    """
    behind, above = place
    low, high = 0.0, HEAD_MM
    center = np.array(CENTER_SKULL)
    if side:
        for _ in range(BISECTIONS):
            x = 0.5 * (low + high)
            v = np.array((x, -behind, above)) - center
            distance = np.linalg.norm(v)
            inside = distance < egg.value((v / distance)[None])[0]
            low, high = (x, high) if inside else (low, x)
    v = np.array((side * low, -behind, above)) - center
    return v / np.linalg.norm(v)


def tangents(direction: Vector3) -> Floats:
    """Return axes (3, 3): the direction, backward along the head, and the rest; rows."""
    backward = np.array((0.0, -1.0, 0.0))
    if abs(direction @ backward) > 0.9:
        backward = np.array((1.0, 0.0, 0.0))
    e1 = backward - (backward @ direction) * direction
    e1 = e1 / np.linalg.norm(e1)
    return np.stack((direction, e1, np.cross(direction, e1)))


def trace_curve(waypoints: Floats, step: float, wiggle: Floats | None = None) -> Floats:
    """Return unit directions (m, 3), ``step`` radians apart, on a smooth curve.

    Args:
        waypoints: Unit directions (k, 3) that the curve passes through, k >= 2.
        step: Angle between neighbours.
        wiggle: Amplitudes, wave numbers (per radian) and phases (3, j) of a sideways zigzag.
    """
    chords = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    knots = np.concatenate(([0.0], np.cumsum(chords)))
    s = np.linspace(0.0, knots[-1], max(2, int(np.ceil(knots[-1] / step)) + 1))
    spline = CubicSpline(knots, waypoints)
    points = spline(s)
    if wiggle is not None:
        sideways = np.cross(points, spline(s, 1))
        sideways = sideways / np.linalg.norm(sideways, axis=1, keepdims=True)
        amplitudes, numbers, phases = wiggle
        points = points + (np.sin(np.outer(s, numbers) + phases) @ amplitudes)[:, None] * sideways
    return points / np.linalg.norm(points, axis=1, keepdims=True)
