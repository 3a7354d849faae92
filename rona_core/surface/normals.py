"""Surface normals from a cloud: a plane through the points around each place."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Bools, Floats, Ints, as_points, as_vector3, readonly
from rona_core.errors import InvalidInputError
from rona_core.surface.hashing import CellHash

NormalMethod = Literal["ols", "tls"]
METHODS: tuple[NormalMethod, ...] = ("ols", "tls")

MIN_COUNT = 6  # points; with fewer, three of them may decide
MIN_FLATNESS = 9.0  # variance across the narrow direction of the patch over that along the normal
MIN_WIDTH = 0.05  # variance across the patch over that along it; a single strand is below
MIN_FACING = 0.1  # |cos| to the outward direction; below it the sign is a guess


@dataclass(frozen=True, slots=True, eq=False)
class Normals:
    """Surface normals at m places, and how far each can be trusted.

    Where ``ok`` is False the normal is not to be used; it then holds the best that the points
    gave, or the outward direction where fewer than three points were near.
    """

    normals: Floats  # (m, 3) unit, in the frame of the points, out of the bone
    count: Ints  # (m,) points within the radius
    eigenvalues: Floats  # (m, 3) variances of those points, ascending, mm^2
    sigma_deg: Floats  # (m,) predicted error from the scatter; 180 where there is no plane
    ok: Bools  # (m,)
    radius_mm: float
    method: str

    def __len__(self) -> int:
        return len(self.normals)


class NormalField:
    """A cloud prepared for the normals at any number of places.

    Places need not belong to the cloud; they should be close to it.
    """

    def __init__(self, points_base: ArrayLike, radius_mm: float = 8.0) -> None:
        """Hash ``points_base`` (n, 3) for neighbourhoods of ``radius_mm``.

        Raises:
            InvalidInputError: wrong shape, values not finite, or a radius that is not positive.
        """
        points = as_points(points_base, name="points_base")
        if not 0.0 < radius_mm < np.inf:
            raise InvalidInputError(f"radius_mm must be positive, not {radius_mm}")
        self._radius_mm = float(radius_mm)
        self._hash = CellHash(points, self._radius_mm)

    def normals(
        self,
        at: ArrayLike,
        *,
        method: NormalMethod = "ols",
        outward: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
    ) -> Normals:
        """Return the normals at places ``at`` (m, 3).

        Args:
            at: Places in the frame of the points, mm.
            method: "ols", the paper's regression plane: one coordinate is regressed on the other
                two, for each of the three, and the one with the largest denominator is kept;
                noise tilts it towards that axis. "tls": least squared distances to the plane.
            outward: A direction (3,) that points out of the bone; or
            viewpoint: a place (3,) outside the bone, from which all of it is seen.

        Raises:
            InvalidInputError: wrong shapes, unknown method, or not exactly one of ``outward`` and
                ``viewpoint``.
        """
        if method not in METHODS:
            raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
        places = as_points(at, name="at")
        sides = _outward_at(places, outward, viewpoint)
        count = np.zeros(len(places), dtype=np.int64)
        scatter = np.zeros((len(places), 3, 3))
        for i, place in enumerate(places):
            near = self._hash.near(place)
            count[i] = len(near)
            if len(near):
                centred = near - near.mean(axis=0)
                scatter[i] = centred.T @ centred / len(near)
        eigenvalues, axes = np.linalg.eigh(scatter)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        normals = axes[:, :, 0] if method == "tls" else _regression_normals(scatter)
        bare = (count < 3) | (np.linalg.norm(normals, axis=1) < 0.5)
        normals = np.where(bare[:, None], sides, normals)
        facing = np.einsum("ij,ij->i", normals, sides)
        normals = normals * np.where(facing < 0, -1.0, 1.0)[:, None]
        thin, narrow, wide = eigenvalues.T
        ok = (
            ~bare
            & (count >= MIN_COUNT)
            & (narrow > MIN_FLATNESS * thin)
            & (narrow > MIN_WIDTH * wide)
            & (np.abs(facing) >= MIN_FACING)
        )
        return Normals(
            normals=readonly(normals),
            count=readonly(count),
            eigenvalues=readonly(eigenvalues),
            sigma_deg=readonly(_sigma_deg(eigenvalues, count)),
            ok=readonly(ok),
            radius_mm=self._radius_mm,
            method=method,
        )


def _outward_at(places: Floats, outward: ArrayLike | None, viewpoint: ArrayLike | None) -> Floats:
    """Return unit vectors (m, 3) towards the outside of the bone at each place."""
    if outward is not None and viewpoint is None:
        towards = np.broadcast_to(as_vector3(outward, name="outward"), places.shape)
    elif viewpoint is not None and outward is None:
        towards = as_vector3(viewpoint, name="viewpoint") - places
    else:
        raise InvalidInputError("give either outward (a direction) or viewpoint (a place)")
    lengths = np.linalg.norm(towards, axis=1)
    if (lengths == 0.0).any():
        raise InvalidInputError("outward must not be zero, nor viewpoint one of the places")
    return towards / lengths[:, None]


def _regression_normals(scatter: Floats) -> Floats:
    """Return the paper's normals (m, 3) by Equation 2, up to sign; zero where there is no plane.

    With a = 1 the normal is (Syz^2 - Szz Syy, Szz Sxy - Syz Sxz, Sxz Syy - Syz Sxy); b = 1 and
    c = 1 follow by exchanging the letters. The element set to 1 holds its denominator.
    """
    xx, yy, zz = scatter[:, 0, 0], scatter[:, 1, 1], scatter[:, 2, 2]
    xy, xz, yz = scatter[:, 0, 1], scatter[:, 0, 2], scatter[:, 1, 2]
    variants = np.stack(
        (
            np.stack((yz**2 - zz * yy, zz * xy - yz * xz, xz * yy - yz * xy), axis=1),
            np.stack((zz * xy - xz * yz, xz**2 - zz * xx, yz * xx - xz * xy), axis=1),
            np.stack((xz * yy - xy * yz, yz * xx - xy * xz, xy**2 - yy * xx), axis=1),
        ),
        axis=1,
    )
    denominators = np.abs(np.einsum("mii->mi", variants))
    chosen = variants[np.arange(len(scatter)), denominators.argmax(axis=1)]
    lengths = np.linalg.norm(chosen, axis=1)[:, None]
    return np.divide(chosen, lengths, out=np.zeros_like(chosen), where=lengths > 0)


def _sigma_deg(eigenvalues: Floats, count: Ints) -> Floats:
    """Return the predicted error of each normal in degrees from the scatter about its plane."""
    thin, narrow, wide = eigenvalues.T
    solid = (count >= 3) & (narrow > 0)
    n, across, along = (np.where(solid, v, 1.0) for v in (count, narrow, wide))
    sigma = np.rad2deg(np.sqrt(thin / n * (1.0 / across + 1.0 / along)))
    return np.where(solid, np.minimum(sigma, 180.0), 180.0)
