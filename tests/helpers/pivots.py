"""Sweeps of a pointer about its tip as a tracker measures them, for tests of the pivot."""

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.geometry.pose import Poses
from rona_core.geometry.rigid_fit import fit_line_many, fit_rigid_many

GEOMETRY = {
    6: np.array([[-45.0, -28, 0], [43, -34, 0], [36, 31, 0], [-34, 33, 0]]),
    5: np.array([[0.0, 0, 0], [0, 0, 60], [0, 0, 130]]),
}
TIPS = {6: np.array((0.0, -200.0, 0.0)), 5: np.array((0.0, 0.0, 290.0))}
PIVOT = np.array((120.0, -80.0, 1900.0))
SIGMA_MM = 0.35


def orientations(rng, dof, n, cone_deg):
    """Return rotations (n, 3, 3) that tilt an upright shaft evenly over a cone, without spin."""
    angle = np.arccos(rng.uniform(np.cos(np.deg2rad(cone_deg)), 1.0, n))
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n)
    first, second = angle * np.cos(azimuth), angle * np.sin(azimuth)
    none = np.zeros(n)
    tilts = (first, none, second) if dof == 6 else (first, second, none)
    start = Rotation.from_euler("x", 180.0 if dof == 6 else 100.0, degrees=True)
    return (start * Rotation.from_rotvec(np.column_stack(tilts))).as_matrix()


def marker_sweep(rng, dof, *, n=100, cone_deg=20.0, noise=None, sigma_mm=SIGMA_MM, tip=None):
    """Return measured markers (n, m, 3) and the pivot."""
    noise = noise or MarkerNoise()
    R = orientations(rng, dof, n, cone_deg)
    arms = GEOMETRY[dof] - (TIPS[dof] if tip is None else tip)
    markers = PIVOT + np.einsum("nij,kj->nki", R, arms)
    return markers + rng.normal(size=markers.shape) * noise.shape() * sigma_mm, PIVOT


def pose_sweep(rng, dof, noise, **options):
    """Return the poses that a tracker fits to the markers of a sweep, without weights."""
    markers, _ = marker_sweep(rng, dof, noise=noise, **options)
    return fitted_poses(markers, dof)


def fitted_poses(markers, dof):
    """Return the poses that fit markers (n, m, 3) best, without weights."""
    there = np.ones(markers.shape[:2], dtype=bool)
    if dof == 5:
        return fit_line_many(GEOMETRY[5][:, 2], markers, there).Ts_b_a
    return fit_rigid_many(GEOMETRY[6], markers, there).Ts_b_a


def spoiled(rng, poses, kind):
    """Return poses of which some are wrong.

    ``gross``: 5 % off by 5 to 50 mm and 1 to 20 degrees. ``slip``: the tip is 2 to 4 mm away in
    20 % of the poses, each elsewhere. ``slipped for a while``: 3 mm away in the first 20 %.
    """
    n = len(poses)
    R, t = poses.rotations.copy(), poses.translations.copy()
    if kind == "slipped for a while":
        t[: n // 5] += 3.0 * directions(rng, 1)
        return Poses(R, t)
    rows = rng.choice(n, n // (20 if kind == "gross" else 5), replace=False)
    low, high = (5.0, 50.0) if kind == "gross" else (2.0, 4.0)
    t[rows] += directions(rng, len(rows)) * rng.uniform(low, high, (len(rows), 1))
    if kind == "gross":
        angles = np.deg2rad(rng.uniform(1.0, 20.0, (len(rows), 1)))
        R[rows] = Rotation.from_rotvec(directions(rng, len(rows)) * angles).as_matrix() @ R[rows]
    return Poses(R, t)


def directions(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]
