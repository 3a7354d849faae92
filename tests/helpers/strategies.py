"""Shared hypothesis strategies: a seed makes a generator, a generator makes geometry."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import deviate

seeds = st.integers(min_value=0, max_value=2**32 - 1)


def random_rotation(rng):
    return Rotation.random(rng=rng).as_matrix()


def random_pose(rng, reach_mm=3000.0):
    """Return a pose as far away as a tracker or a robot base may be."""
    return Pose(random_rotation(rng), rng.uniform(-reach_mm, reach_mm, 3))


def angle_rad(pose, other):
    """Return the angle between the rotations of two poses."""
    return float(Rotation.from_matrix(pose.rotation.T @ other.rotation).magnitude())


def random_poses(rng, n, reach_mm=3000.0):
    return Poses(Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-reach_mm, reach_mm, (n, 3)))


def near_identity_pose(rng, size):
    """Return a pose that turns and shifts by about ``size`` (rad and mm)."""
    return Pose.from_rotvec(rng.normal(0, size, 3), rng.normal(0, size, 3))


def unit_vectors(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def cap_directions(rng, n, half_angle_deg):
    """Return unit vectors spread evenly over a cap about +z."""
    z = rng.uniform(np.cos(np.deg2rad(half_angle_deg)), 1.0, n)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    across = np.sqrt(1 - z**2)
    return np.column_stack((across * np.cos(azimuth), across * np.sin(azimuth), z))


def cap(rng, n=60, radius_mm=200.0, half_angle_deg=30.0):
    """Return points on a spherical cap about the origin."""
    return radius_mm * cap_directions(rng, n, half_angle_deg)


def thin_points(rng, n, thickness_mm):
    """Return points near a plane through the origin, spread over 100 mm."""
    return rng.normal(size=(n, 3)) * (50.0, 50.0, thickness_mm)


def swings(rng, n, half_angle_deg, *, spin_deg=40.0):
    """Return rotations (n, 3, 3) that tilt z evenly over a cone and spin about it somewhat."""
    z = cap_directions(rng, n, half_angle_deg)
    tilt = np.column_stack((-z[:, 1], z[:, 0], np.zeros(n)))
    size = np.linalg.norm(tilt, axis=1)
    angle = np.arctan2(size, z[:, 2])
    tilt *= (angle / np.maximum(size, 1e-300))[:, None]
    spin = np.zeros((n, 3))
    spin[:, 2] = np.deg2rad(rng.uniform(-spin_deg, spin_deg, n))
    return (Rotation.from_rotvec(tilt) * Rotation.from_rotvec(spin)).as_matrix()


def pivot_poses(rng, tip_marker, *, n=100, half_angle_deg=20.0, reach_mm=2000.0, shaft=None):
    """Return poses of a marker that swings about its tip, and the place of the tip in tracker.

    ``shaft`` (3,) in the marker frame is the direction that is tilted; by default along the tip.
    """
    shaft = np.asarray(tip_marker if shaft is None else shaft, dtype=float)
    R_shaft_marker = Rotation.align_vectors([[0.0, 0.0, 1.0]], [shaft])[0].as_matrix()
    rotations = random_rotation(rng) @ swings(rng, n, half_angle_deg) @ R_shaft_marker
    pivot = rng.uniform(-reach_mm, reach_mm, 3)
    return Poses(rotations, pivot - rotations @ np.asarray(tip_marker)), pivot


def noisy(rng, poses, sigma_mm, sigma_deg):
    """Return poses with white noise: per axis in mm, and per axis in degrees."""
    turns = Rotation.from_rotvec(rng.normal(0, np.deg2rad(sigma_deg), (len(poses), 3)))
    shifts = rng.normal(0, sigma_mm, (len(poses), 3))
    return Poses(poses.rotations @ turns.as_matrix(), poses.translations + shifts)


def disturbed(graph, rng):
    """Return a frame graph with every pose deviated at random by its covariance."""
    drawn = {}
    for joint in graph.joint:
        whole = _draw(joint.covariance, rng)
        drawn |= {name: whole[6 * i : 6 * i + 6] for i, name in enumerate(joint.names)}
    for edge in graph.edges:
        if edge.covariance is not None:
            drawn[edge.name] = _draw(edge.covariance, rng)
    edges = tuple(
        replace(edge, T_a_b=deviate(edge.T_a_b, drawn.get(edge.name, np.zeros(6))))
        for edge in graph.edges
    )
    return replace(graph, edges=edges)


def _draw(covariance, rng):
    """Return one deviation with a covariance that may be singular."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale * (vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.normal(size=len(scale))))
