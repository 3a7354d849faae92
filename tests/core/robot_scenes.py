"""Serpentine paths over a sphere in six places around the robot, for the robot's tests."""

import numpy as np

from rona_core.geometry.path5d import Path5D

SCENES = {  # centre of the sphere (mm), outward normal, constant rolls of 72 that are feasible
    "S0": ((600, 100, 350), (0, 0, 1), 39),
    "S1": ((550, 0, 300), (-0.5, 0.3, 0.8), 13),
    "S2": ((700, 200, 350), (-0.3, 0, 1), 39),
    "S3": ((450, 100, 300), (-1, 0, 0.5), 0),
    "S4": ((650, 0, 400), (-0.8, 0, 0.6), 0),
    "S5": ((500, -300, 300), (0, 0.9, 0.4), 25),
}
RADIUS_MM = 100.0


def serpentine(scene, lines=9, per_line=10, half_mm=40.0):
    """Return waypoints (n, 3) and outward normals (n, 3) of a serpentine on a sphere."""
    place, outward, _ = SCENES[scene]
    up = np.array(outward, dtype=float)
    up /= np.linalg.norm(up)
    helper = np.array((0, 0, 1.0)) if abs(up[2]) < 0.9 else np.array((1.0, 0, 0))
    u = helper - (helper @ up) * up
    u /= np.linalg.norm(u)
    v = np.cross(up, u)
    normals = []
    for i, across in enumerate(np.linspace(-half_mm, half_mm, lines)):
        for along in np.linspace(-half_mm, half_mm, per_line)[:: 1 if i % 2 == 0 else -1]:
            length = np.hypot(across, along)
            side = (across * u + along * v) / length if length > 0 else u
            angle = length / RADIUS_MM
            normals.append(np.cos(angle) * up + np.sin(angle) * side)
    normals = np.array(normals)
    return np.array(place, dtype=float) + RADIUS_MM * normals, normals


def dense_path(scene, step_mm=1.0, step_deg=1.0, **options):
    """Return the serpentine as a Path5D: straight in position, evenly turning in direction."""
    points, normals = serpentine(scene, **options)
    out_points, out_axes = [points[:1]], [-normals[:1]]
    for p, q, a, b in zip(points[:-1], points[1:], -normals[:-1], -normals[1:], strict=True):
        angle = np.arccos(np.clip(a @ b, -1, 1))
        n = int(np.ceil(max(np.linalg.norm(q - p) / step_mm, np.rad2deg(angle) / step_deg, 1)))
        t = np.arange(1, n + 1)[:, None] / n
        out_points.append(p + t * (q - p))
        if angle < 1e-12:
            out_axes.append(np.repeat(b[None], n, axis=0))
        else:
            turned = (np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle)
            out_axes.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
    return Path5D(np.concatenate(out_points), np.concatenate(out_axes))
