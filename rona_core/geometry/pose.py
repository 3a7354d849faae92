"""Rigid poses: ``T_base_tip`` is the pose of ``tip`` in ``base``, p_base = T_base_tip @ p_tip."""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self, overload

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_floats, as_vector3, readonly

ROTATION_TOLERANCE = 1e-6
ROUNDING = 1e-3  # R R' of a rotation printed with four digits differs from the identity by less
UNIT = readonly(np.eye(3))


def as_rotations(rotations: ArrayLike) -> Floats:
    """Return ``rotations`` (..., 3, 3) after checking that each is orthonormal and right-handed.

    Raises:
        InvalidInputError: wrong shape, or not rotations.
    """
    r = as_floats(rotations, name="rotations")
    if r.shape[-2:] != (3, 3):
        raise InvalidInputError(f"a rotation must have shape (3, 3), not {r.shape[-2:]}")
    if r.ndim == 2:
        error, handedness = _of_one_matrix(r)
    else:
        error = float(np.abs(r @ np.swapaxes(r, -1, -2) - UNIT).max(initial=0.0))
        handedness = float(determinants(r).min(initial=1.0))
    if error > ROTATION_TOLERANCE or handedness < 0.0:
        raise InvalidInputError(
            f"not a rotation: R R' differs from the identity by {error:.2g} or is mirrored"
            + ("; Poses.from_matrices mends rounded digits" if error <= ROUNDING else "")
        )
    return r


def without_rounding(rotations: Floats) -> tuple[Floats, Floats]:
    """Return the rigid rotations next to some with few digits, and how far off each was.

    Those that are rigid keep every bit; so do those that are no rotations at all, which are for the
    caller to refuse.

    Args:
        rotations: (n, 3, 3).

    Returns:
        Rotations (n, 3, 3), and the largest difference of R R' from the identity (n,).
    """
    square = rotations @ np.swapaxes(rotations, 1, 2)
    off = np.abs(square - UNIT).max(axis=(1, 2), initial=0.0)
    rounded = (off > ROTATION_TOLERANCE / 2.0) & (off <= ROUNDING)
    if not rounded.any():
        return rotations, off
    u, _, vt = np.linalg.svd(rotations[rounded])
    mended = rotations.copy()
    mended[rounded] = u @ vt
    return mended, off


def determinants(matrices: Floats) -> Floats:
    """Return the determinants (...) of matrices (..., 3, 3); LAPACK takes each by itself."""
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrices, (-2, -1), (0, 1))
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _of_one_matrix(matrix: Floats) -> tuple[float, float]:
    """Return by how much R R' of one (3, 3) differs from the identity, and its determinant.

    In plain numbers: single poses are made by the hundred thousand, and arrays of nine are slow.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    error = max(
        abs(a * a + b * b + c * c - 1.0),
        abs(d * d + e * e + f * f - 1.0),
        abs(g * g + h * h + i * i - 1.0),
        abs(a * d + b * e + c * f),
        abs(a * g + b * h + c * i),
        abs(d * g + e * h + f * i),
    )
    return error, a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """One rigid pose: rotation (3, 3) and translation (3,) in millimetres."""

    rotation: Floats
    translation: Vector3

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", readonly(as_rotations(self.rotation)))
        object.__setattr__(self, "translation", readonly(as_vector3(self.translation)))

    @classmethod
    def unchecked(cls, rotation: Floats, translation: Vector3) -> "Pose":
        """Return a rotation (3, 3) and a translation (3,) that are valid by construction."""
        pose = object.__new__(cls)
        object.__setattr__(pose, "rotation", readonly(rotation))
        object.__setattr__(pose, "translation", readonly(translation))
        return pose

    @classmethod
    def identity(cls) -> Self:
        """Return the pose that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_translation(cls, translation: ArrayLike) -> Self:
        """Return a pose without rotation."""
        return cls(np.eye(3), as_vector3(translation))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Self:
        """Return the pose of a homogeneous (4, 4) matrix; see `Poses.from_matrices`."""
        poses = Poses.from_matrices(as_floats(matrix, name="matrix")[None])
        return cls(poses.rotations[0], poses.translations[0])

    @classmethod
    def from_rotvec(cls, rotvec_rad: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Self:
        """Return the pose turned by a rotation vector (3,) in radians, then shifted (mm)."""
        rotation = Rotation.from_rotvec(as_vector3(rotvec_rad)).as_matrix()
        return cls(rotation, as_vector3(translation))

    @classmethod
    def from_wxyz(cls, wxyz: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Self:
        """Return the pose of a quaternion (w, x, y, z) and a translation (mm)."""
        q = as_floats(wxyz, name="wxyz")
        rotation = Rotation.from_quat(q, scalar_first=True).as_matrix()
        return cls(rotation, as_vector3(translation))

    def matrix(self) -> Floats:
        """Return the homogeneous (4, 4) matrix."""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = self.rotation, self.translation
        return m

    def wxyz(self) -> Floats:
        """Return the rotation as a quaternion (w, x, y, z) with w >= 0."""
        return Rotation.from_matrix(self.rotation).as_quat(canonical=True, scalar_first=True)

    def inv(self) -> "Pose":
        """Return the inverse: ``T_base_tip.inv()`` is ``T_tip_base``."""
        return Pose.unchecked(self.rotation.T.copy(), -self.rotation.T @ self.translation)

    def repeated(self, n: int) -> "Poses":
        """Return this pose n times."""
        rotations, translations = (
            np.tile(self.rotation, (n, 1, 1)),
            np.tile(self.translation, (n, 1)),
        )
        return Poses.unchecked(rotations, translations)

    def rotate(self, vectors: ArrayLike) -> Floats:
        """Return directions (3,) or (n, 3) turned into the left frame, without translation."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    @overload
    def __matmul__(self, other: "Pose") -> "Pose": ...
    @overload
    def __matmul__(self, other: "Poses") -> "Poses": ...
    @overload
    def __matmul__(self, other: ArrayLike) -> Floats: ...
    def __matmul__(self, other: "Pose | Poses | ArrayLike") -> "Pose | Poses | Floats":
        """Chain poses, or map points (3,) or (n, 3) into the left frame."""
        if isinstance(other, Pose):
            return Pose.unchecked(
                self.rotation @ other.rotation,
                self.rotation @ other.translation + self.translation,
            )
        if isinstance(other, Poses):
            return Poses.unchecked(
                self.rotation @ other.rotations,
                other.translations @ self.rotation.T + self.translation,
            )
        return np.asarray(other, dtype=np.float64) @ self.rotation.T + self.translation


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """A batch of rigid poses (``Ts_base_probe``): rotations (n, 3, 3), translations (n, 3) mm."""

    rotations: Floats
    translations: Floats

    def __post_init__(self) -> None:
        rotations, translations = as_rotations(self.rotations), as_floats(self.translations)
        if rotations.ndim != 3 or translations.shape != (len(rotations), 3):
            raise InvalidInputError(
                f"expected rotations (n, 3, 3) and translations (n, 3), "
                f"got {rotations.shape} and {translations.shape}"
            )
        object.__setattr__(self, "rotations", readonly(rotations))
        object.__setattr__(self, "translations", readonly(translations))

    @classmethod
    def unchecked(cls, rotations: Floats, translations: Floats) -> "Poses":
        """Return rotations (n, 3, 3) and translations (n, 3) that are valid by construction."""
        poses = object.__new__(cls)
        for name, array in (("rotations", rotations), ("translations", translations)):
            object.__setattr__(poses, name, readonly(array))
        return poses

    @classmethod
    def from_matrices(cls, matrices: ArrayLike) -> Self:
        """Return the poses of homogeneous matrices (n, 4, 4) or (n, 3, 4).

        Rotations with as few digits as files are printed with become the nearest rigid ones, and a
        UserWarning says so.

        Raises:
            InvalidInputError: wrong shape, wrong last row, or not rotations.
        """
        m = as_floats(matrices, name="matrices")
        if m.ndim != 3 or m.shape[1:] not in ((4, 4), (3, 4)):
            raise InvalidInputError(
                f"expected homogeneous matrices (n, 4, 4) or (n, 3, 4), got shape {m.shape}"
            )
        if not np.allclose(m[:, 3:], (0, 0, 0, 1)):
            raise InvalidInputError("expected matrices whose last row is 0 0 0 1")
        rotations, off = without_rounding(m[:, :3, :3])
        if ROTATION_TOLERANCE < off.max(initial=0.0) <= ROUNDING:
            warnings.warn(
                f"rotations were off by up to {off.max():.1g} and were made orthogonal",
                stacklevel=2,
            )
        return cls(rotations.copy(), m[:, :3, 3].copy())

    @classmethod
    def stack(cls, poses: Sequence[Pose]) -> Self:
        """Return single poses as one batch; an empty sequence gives an empty batch."""
        if not poses:
            return cls(np.zeros((0, 3, 3)), np.zeros((0, 3)))
        return cls(
            np.stack([pose.rotation for pose in poses]),
            np.stack([pose.translation for pose in poses]),
        )

    @classmethod
    def joined(cls, parts: "Sequence[Poses]") -> "Poses":
        """Return several batches, at least one, as one; of a single one that very batch."""
        if len(parts) == 1:
            return parts[0]
        return cls.unchecked(
            np.concatenate([part.rotations for part in parts]),
            np.concatenate([part.translations for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, index: int) -> Pose:
        pose = object.__new__(Pose)  # views of what cannot be written need no copy
        object.__setattr__(pose, "rotation", self.rotations[index])
        object.__setattr__(pose, "translation", self.translations[index])
        return pose

    def __iter__(self) -> Iterator[Pose]:
        return (self[i] for i in range(len(self)))

    def select(self, index: ArrayLike | slice) -> "Poses":
        """Return the poses chosen by a slice, a mask or an array of indices."""
        chosen = index if isinstance(index, slice) else np.asarray(index)
        return Poses.unchecked(self.rotations[chosen], self.translations[chosen])

    def inv(self) -> "Poses":
        """Return each inverse."""
        turned = np.swapaxes(self.rotations, 1, 2)
        return Poses.unchecked(turned.copy(), -np.einsum("nij,nj->ni", turned, self.translations))

    def wxyz(self) -> Floats:
        """Return the rotations as quaternions (n, 4), w first and not negative."""
        if not len(self):
            return np.zeros((0, 4))
        return Rotation.from_matrix(self.rotations).as_quat(canonical=True, scalar_first=True)

    def mean(self) -> Pose:
        """Return the mean pose: chordal mean of the rotations, mean of the translations.

        Raises:
            InvalidInputError: no poses.
        """
        if not len(self):
            raise InvalidInputError("the mean of no poses was asked for")
        u, _, vt = np.linalg.svd(self.rotations.mean(axis=0))
        handed = np.sign(np.linalg.det(u @ vt))
        return Pose(u @ np.diag((1.0, 1.0, handed)) @ vt, self.translations.mean(axis=0))

    def map_points(self, points: Floats) -> Floats:
        """Return points (m, 3) mapped by each of the n poses into the left frame, (n, m, 3)."""
        x, y, z = (self.rotations[:, None, :, i] * points[:, i, None] for i in range(3))
        x += z  # added one by one, as einsum does it, in half of its time
        x += y
        x += self.translations[:, None]
        return x

    @overload
    def __matmul__(self, other: "Pose | Poses") -> "Poses": ...
    @overload
    def __matmul__(self, other: ArrayLike) -> Floats: ...
    def __matmul__(self, other: "Pose | Poses | ArrayLike") -> "Poses | Floats":
        """Chain pose by pose, or map one point (3,) or one point each (n, 3)."""
        if isinstance(other, Pose):
            return Poses.unchecked(
                self.rotations @ other.rotation,
                self.rotations @ other.translation + self.translations,
            )
        if isinstance(other, Poses):
            return Poses.unchecked(
                self.rotations @ other.rotations,
                np.einsum("nij,nj->ni", self.rotations, other.translations) + self.translations,
            )
        points = np.asarray(other, dtype=np.float64)
        if points.ndim == 1:
            return self.rotations @ points + self.translations
        return np.einsum("nij,nj->ni", self.rotations, points) + self.translations
