"""Random pivots and strokes as trackers record them, and the changes that people make of poses."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.geometry.pose import Poses
from rona_core.geometry.rigid_fit import fit_rigid_many


@dataclass(frozen=True)
class Pivot:
    """Measured poses, and the truth."""

    poses: Poses
    tip: Any
    pivot: Any


def random_pivot(seed, *, n=None, outliers=True, noise_mm=None):
    """Return a pivot: tip 50 to 250 mm, cone 10 to 60 degrees, noise 0.1 to 0.5 mm a marker.

    20 to 1000 poses at random, on a spiral or on a smooth path, seen by a tracker 0.95 to 2.4 m
    away, up to a tenth of them with gross errors.
    """
    rng = np.random.default_rng(seed)
    length = rng.uniform(50.0, 250.0)
    tip = rng.normal(size=3)
    tip *= length / np.linalg.norm(tip)
    n = int(np.exp(rng.uniform(np.log(20.0), np.log(1000.0)))) if n is None else n
    noise_mm = rng.uniform(0.1, 0.5) if noise_mm is None else noise_mm
    tilts, azimuths, spins = _motion(rng, n, np.deg2rad(rng.uniform(10.0, 60.0)))
    across = np.column_stack((-np.sin(azimuths), np.cos(azimuths), np.zeros(n)))
    along = np.column_stack((np.zeros(n), np.zeros(n), spins))
    shaft = Rotation.align_vectors([tip / length], [[0.0, 0.0, 1.0]])[0]
    swing = Rotation.from_rotvec(tilts[:, None] * across) * Rotation.from_rotvec(along)
    R = (Rotation.random(rng=rng) * shaft * swing * shaft.inv()).as_matrix()
    depth = rng.choice((-1.0, 1.0)) * rng.uniform(950.0, 2400.0)
    pivot = np.array((*rng.uniform(-400.0, 400.0, 2), depth))
    body = rng.uniform(-45.0, 45.0, (rng.integers(3, 6), 3))
    while np.linalg.svd(body - body.mean(axis=0))[1][1] < 25.0:
        body = rng.uniform(-45.0, 45.0, body.shape)
    points = np.einsum("nij,mj->nmi", R, body) + (pivot - R @ tip)[:, None]
    points += rng.normal(size=points.shape) * noise_mm / np.sqrt(3.0)
    seen = fit_rigid_many(body, points, np.ones(points.shape[:2], dtype=np.bool_)).Ts_b_a
    R, t = seen.rotations.copy(), seen.translations.copy()
    out = rng.random(n) < (rng.choice((0.0, 0.03, 0.1)) if outliers else 0.0)
    t[out] += rng.normal(0.0, 20.0, (int(out.sum()), 3))
    turns = Rotation.from_rotvec(rng.normal(0.0, 0.1, (int(out.sum()), 3))).as_matrix()
    R[out] = turns @ R[out]
    return Pivot(Poses(R, t), tip, pivot)


@dataclass(frozen=True)
class Stroke:
    """Measured poses of a pointer whose tip slides over bone, and the tip in its marker."""

    poses: Poses
    tip: Any


def random_stroke(seed):
    """Return a stroke over an ellipsoid as large as a head, the pointer tilted as a hand does it.

    Tip 80 to 250 mm from the marker, loops 20 to 70 mm across in 10 to 40 s at 30 Hz, tilts of 6 to
    25 degrees from the normal and a spin, noise of 0.05 to 0.3 mm and 0.02 to 0.1 degrees, a
    twentieth of the poses off the bone.
    """
    rng = np.random.default_rng((seed, 1))
    length, n = rng.uniform(80.0, 250.0), int(rng.uniform(300, 1200))
    tip = rng.normal(size=3)
    tip *= length / np.linalg.norm(tip)
    s = np.linspace(0.0, 1.0, n) * n / 30.0

    def wave(rates):
        made = sum(rng.normal() * np.sin(f * s + rng.uniform(0.0, 6.0)) for f in rates)
        return made / np.abs(made).max()

    u, v = (rng.uniform(10.0, 35.0) * wave((0.3, 0.7, 1.3)) for _ in "uv")
    axes = rng.uniform(70.0, 110.0, 3)
    height = axes[2] * np.sqrt(1.0 - (u / axes[0]) ** 2 - (v / axes[1]) ** 2)
    points = np.column_stack((u, v, height))
    normals = points / axes**2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    off = rng.random(n) < 0.05
    points = points + off[:, None] * rng.uniform(0.0, 10.0, (n, 1)) * normals
    upright = [Rotation.align_vectors([one], [[0.0, 0.0, 1.0]])[0] for one in normals]
    most = np.deg2rad(rng.uniform(6.0, 25.0))
    rates = ((0.2, 0.9, 1.9), (0.4, 1.1, 2.3), (0.15, 0.5))
    tilt = np.column_stack([most * wave(each) for each in rates])
    shaft = Rotation.align_vectors([-tip / length], [[0.0, 0.0, 1.0]])[0]
    R = Rotation.concatenate(upright) * Rotation.from_rotvec(tilt) * shaft.inv()
    at = Rotation.random(rng=rng)
    depth = rng.choice((-1.0, 1.0)) * rng.uniform(950.0, 2400.0)
    place = np.array((*rng.uniform(-400.0, 400.0, 2), depth))
    shake = Rotation.from_rotvec(rng.normal(size=(n, 3)) * np.deg2rad(rng.uniform(0.02, 0.1)))
    R = (at * R * shake).as_matrix()
    t = at.apply(points) + place - R @ tip
    t += rng.normal(size=t.shape) * rng.uniform(0.05, 0.3) / np.sqrt(3.0)
    return Stroke(Poses(R, t), tip)


def _motion(rng, n, cone):
    """Return tilts, azimuths and spins (n,) in rad."""
    kind, s = rng.integers(3), np.linspace(0.0, 1.0, n)
    if kind == 0:
        tilts = np.arccos(rng.uniform(np.cos(cone), 1.0, n))
        return tilts, rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(-0.3, 0.3, n)
    if kind == 1:
        return cone * np.sqrt(s), 2.0 * np.pi * rng.uniform(3.0, 12.0) * s, 0.2 * np.sin(7.0 * s)
    s = s * rng.uniform(10.0, 40.0)
    ways = [
        sum(rng.normal() * np.sin(f * s + rng.uniform(0.0, 6.0)) for f in rates)
        for rates in ((0.5, 0.9, 1.7), (0.6, 1.1, 1.5))
    ]
    tilts = np.hypot(*ways)
    return tilts / tilts.max() * cone, np.arctan2(ways[1], ways[0]), 0.2 * np.sin(0.3 * s)


def _reordered(poses, by):
    q = np.roll(Rotation.from_matrix(poses.rotations).as_quat(), by, axis=1)
    return Poses(Rotation.from_quat(q).as_matrix(), poses.translations)


def _mirrored(axis, poses, rotations):
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    if rotations:
        return Poses(signs[:, None] * poses.rotations * signs, poses.translations)
    return Poses(poses.rotations, poses.translations * signs)


WRONG = {  # the name of a change -> how it is made
    "inverted": lambda p: p.inv(),
    "transposed": lambda p: Poses(np.swapaxes(p.rotations, 1, 2), p.translations),
    "real part first": lambda p: _reordered(p, 1),
    "real part last": lambda p: _reordered(p, -1),
    "mirrored x": lambda p: _mirrored(0, p, rotations=False),
    "mirrored y": lambda p: _mirrored(1, p, rotations=True),
    "mirrored z": lambda p: _mirrored(2, p, rotations=False),
    "rotation late": lambda p: Poses(p.rotations[:-1], p.translations[1:]),
    "rotation early": lambda p: Poses(p.rotations[1:], p.translations[:-1]),
}
