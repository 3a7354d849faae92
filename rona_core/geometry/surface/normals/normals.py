"""Surface normals from a point cloud, with predicted errors, flags, and where to sample again.

Choice of the neighbourhood radius for normals: noise against bias. After Mitra and Nguyen 2003 the
error of a normal is noise, falling with the square of the radius and the root of the density, plus
a lean, rising with it. Both are measured on the cloud itself: the noise from the scatter about
small quadrics; the lean from how far normals of wide neighbourhoods turn away from those of narrow
ones, beyond what the noise explains.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_points, as_vector3, readonly
from rona_core.geometry.surface.normals.normal_estimator import (
    COEFFICIENTS,
    DISC_GAIN,
    EDGE_ON,
    METHODS,
    ONE_SIDED,
    UNCERTAIN,
    Estimates,
    NormalMethod,
    estimate,
)

RADII_MM = readonly(2.0 * 2.0 ** (np.arange(12) / 3.0))  # 2 to 25 mm, a third of an octave apart
SAMPLES = 300  # points of the cloud at which radii are tried
MIN_SHARE = 0.9  # of them with a usable normal, for a radius to be considered
SURE = 2.0  # standard errors by which normals must differ to show a lean
WORSE = 4.0  # times the least expected square: no wider radius is tried
ENOUGH_RAD = np.deg2rad(0.1)  # of noise: no wider radius is needed
CENTRED_GAIN = 4.0  # in full discs; places with more are at a rim and left out
DEFAULT_MM = 8.0  # where nothing can be learnt


@dataclass(frozen=True, slots=True, eq=False)
class RadiusChoice:
    """The radius with the least expected error, and what was weighed against what."""

    radius_mm: float
    noise_mm: float  # of one point, along the normal
    density_per_mm2: float
    curvature_per_mm: float  # larger principal curvature, median
    radii_mm: Floats  # (k,) that were tried
    noise_deg: Floats  # (k,) RMS error by noise that each of them leaves
    lean_deg: Floats  # (k,) RMS error by relief and curvature that each of them brings

    def lean_at_deg(self, radii_mm: Floats) -> Floats:
        """Return the error by relief and curvature at some radii; 0 where none was tried."""
        if not len(self.radii_mm):
            return np.zeros(np.shape(radii_mm))
        return np.interp(radii_mm, self.radii_mm, self.lean_deg)


def choose_radius(points: Floats, method: NormalMethod) -> RadiusChoice:
    """Return the radius to be used for ``method`` on a cloud."""
    radii: list[float] = []
    fits: list[Estimates] = []
    noise2, curvature = 0.0, 0.0
    noise = bias = np.zeros(0)
    for radius, jet in _usable(points):
        fit = jet
        if method != "jet":
            fit = estimate(points, _sample(points), radius, method, None)
            if np.mean((fit.flag == 0) | (fit.flag == ONE_SIDED)) < MIN_SHARE:
                continue
        if not radii:
            noise2 = _noise_mm2(jet)
        radii.append(radius)
        fits.append(fit)
        noise, bias = _errors(radii, fits, noise2, len(points))
        risk = noise + bias
        if risk.argmin() == len(risk) - 1:
            curvature = float(np.median(jet.curvature_per_mm[jet.flag == 0]))
        if noise[-1] < ENOUGH_RAD**2 or risk[-1] > WORSE * risk.min():
            break
    best = int((noise + bias).argmin()) if radii else 0
    return RadiusChoice(
        radius_mm=radii[best] if radii else DEFAULT_MM,
        noise_mm=float(np.sqrt(noise2)),
        density_per_mm2=_density(fits[best], radii[best]) if radii else 0.0,
        curvature_per_mm=curvature,
        radii_mm=readonly(np.array(radii)),
        noise_deg=readonly(np.rad2deg(np.sqrt(noise))),
        lean_deg=readonly(np.rad2deg(np.sqrt(bias))),
    )


def measure_noise_mm(points: Floats) -> float | None:
    """Return the noise of one point along the normal, or None where no quadric can be fitted."""
    for _, jet in _usable(points):
        return float(np.sqrt(_noise_mm2(jet)))
    return None


def _sample(points: Floats) -> Floats:
    return points[:: max(1, len(points) // SAMPLES)]


def _usable(points: Floats) -> Iterator[tuple[float, Estimates]]:
    """Yield the radii, ascending, at which nearly all quadrics can be fitted, and these."""
    if not len(points):
        return
    for radius in RADII_MM.tolist():
        jet = estimate(points, _sample(points), radius, "jet", None)
        if np.mean(jet.flag == 0) >= MIN_SHARE:
            yield radius, jet


def _noise_mm2(jet: Estimates) -> float:
    """Return the variance of one point: the median over places, freed of its own bias."""
    good = jet.flag == 0
    spare = np.maximum(jet.count[good] - COEFFICIENTS, 1)
    return float(np.median(jet.noise_mm2[good] / (1.0 - 2.0 / (9.0 * spare)) ** 3))


def _density(fit: Estimates, radius: float) -> float:
    return float(np.median(fit.count) / (np.pi * radius**2))


def _errors(
    radii: list[float], fits: list[Estimates], noise2: float, n: int
) -> tuple[Floats, Floats]:
    """Return the mean squares in rad^2 by noise and by relief, for each radius.

    Normals of one neighbourhood within another differ by the difference of their variances and
    by the lean of the wider one. A lean counts when it is sure in the face of so many places.
    """
    noise, bias = np.zeros(len(radii)), np.zeros(len(radii))
    inner = [_centred(fit, radius) for fit, radius in zip(fits, radii, strict=True)]
    for k, fit in enumerate(fits):
        noise[k] = noise2 * fit.gain[inner[k]].mean()
        for j in range(k):
            both = inner[k] & inner[j]
            if not both.any():
                continue
            other = fits[j]
            cross = np.cross(fit.normals[both], other.normals[both])
            squared_angles = np.arcsin(np.minimum(np.linalg.norm(cross, axis=1), 1.0)) ** 2
            by_noise = float(noise2 * (other.gain[both] - fit.gain[both]).mean())
            apart = n / max(_density(other, radii[j]) * np.pi * radii[j] ** 2, 1.0)
            standard_error = (
                SURE * float(squared_angles.std()) / np.sqrt(max(min(apart, both.sum()), 4.0))
            )
            bias[k] = max(bias[k], float(squared_angles.mean()) - by_noise - standard_error)
    return noise, np.maximum.accumulate(bias)


def centred(fit: Estimates, radii_mm: Floats) -> Bools:
    """Return where points lie all round, so that noise turns the normal hardly more than there."""
    return np.asarray(fit.gain * fit.count * radii_mm**2 < CENTRED_GAIN * DISC_GAIN)


def _centred(fit: Estimates, radius: float) -> Bools:
    """Return which places have usable points all round; all usable ones where these are few."""
    good = fit.flag == 0
    inner = good & centred(fit, np.array(radius))
    return inner if inner.sum() >= 20 else (good if good.any() else np.ones_like(good))


NormalFlag = Literal[
    "ok", "too_few", "rank_deficient", "not_flat", "one_sided", "edge_on", "uncertain"
]
FLAGS: tuple[NormalFlag, ...] = (
    "ok",
    "too_few",  # points near the place
    "rank_deficient",  # they lie along one strand, or do not fix the quadric
    "not_flat",  # they are as thick as they are wide
    "one_sided",  # a plane through them leans with the curvature; the quadric does not
    "edge_on",  # the plane is seen from its edge: which side is outside is a guess
    "uncertain",  # noise or relief may turn the normal by over 5 degrees
)
MIN_FACING = 0.1  # |cos| to the outward direction; below it the sign is a guess
MAX_WIDER = 3  # steps of the ladder of radii for a place that the chosen radius does not suit
MAX_SIGMA_DEG = 1.0  # a probe of 6 mm at 5 MHz loses half its echo at 1.0 degree, of 3 mm at 2.1
NO_PLANE_DEG = 180.0  # error of a normal where there is no plane
MOST = 16.0  # times as many points; more are not asked for at once
REASONS = {
    "too_few": "too few points near",
    "rank_deficient": "points along one strand only: slide across as well",
    "not_flat": "points as thick as wide: lifted pointer, or an edge",
    "one_sided": "points on one side only: slide beyond",
    "edge_on": "surface seen from its edge",
    "widened": "too few points near: a wider neighbourhood had to serve",
    "uncertain": "noise or fine relief leaves the normal uncertain: slide slower or denser",
}


@dataclass(frozen=True, slots=True, eq=False)
class Normals:
    """Surface normals at m places, and how far each can be trusted.

    Where ``ok`` is False the normal is not to be used, and ``flags`` says why; it then holds the
    best that the points gave, or the outward direction where too few points were near.
    """

    normals: Floats  # (m, 3) unit, in the frame of the points, out of the bone
    count: Ints  # (m,) points within the radius
    eigenvalues: Floats  # (m, 3) variances of those points, ascending, mm^2
    sigma_deg: Floats  # (m,) predicted RMS error; 180 where there is no plane
    ok: Bools  # (m,)
    radius_mm: float
    method: str
    refused: dict[str, tuple[int, ...]]  # name of the flag -> the places that are not ok
    radii_mm: Floats | None  # (m,) where some places needed wider ones; None: the same for all
    choice: RadiusChoice | None  # how the radius was chosen; None where it was given

    def __len__(self) -> int:
        return len(self.normals)

    @property
    def flags(self) -> tuple[str, ...]:
        """Return for each place "ok" or the name of what is wrong there, see ``FLAGS``."""
        flags = ["ok"] * len(self.normals)
        for flag, places in self.refused.items():
            for place in places:
                flags[place] = flag
        return tuple(flags)


class NormalField:
    """A cloud prepared for the normals at any number of places.

    Places need not belong to the cloud; they should be close to it.
    """

    def __init__(self, points_base: ArrayLike, radius_mm: float | None = None) -> None:
        """Take ``points_base`` (n, 3).

        Args:
            points_base: The cloud, mm.
            radius_mm: Size of the neighbourhoods. None lets noise, density and curvature of the
                cloud decide.

        Raises:
            InvalidInputError: wrong shape, values not finite, or a radius that is not positive.
        """
        if radius_mm is not None and not 0.0 < radius_mm < np.inf:
            raise InvalidInputError(f"radius_mm must be positive, not {radius_mm}")
        self._radius_mm = None if radius_mm is None else float(radius_mm)
        self._points = as_points(points_base, name="points_base")

    def normals(
        self,
        at: ArrayLike,
        *,
        method: NormalMethod = "jet",
        outward: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
    ) -> Normals:
        """Return the normals at places ``at`` (m, 3).

        Args:
            at: Places in the frame of the points, mm.
            method: "jet", a quadric: right also where all points lie on one side, and over relief.
                "plane", the plane of least squared distances, by the paper's Equation 2.
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
        if self._radius_mm is not None:
            noise_mm = measure_noise_mm(self._points) if method == "jet" else None
            found = estimate(self._points, places, self._radius_mm, method, noise_mm)
            return _judged(found, sides, self._radius_mm, method, None, None)
        choice = choose_radius(self._points, method)
        noise_mm = choice.noise_mm if len(choice.radii_mm) else None
        found = estimate(self._points, places, choice.radius_mm, method, noise_mm)
        radii = self._widen(found, places, method, choice)
        solved = found.sigma_deg < NO_PLANE_DEG
        lean_deg = np.where(solved, choice.lean_at_deg(radii), 0.0)
        found.sigma_deg = np.minimum(np.hypot(found.sigma_deg, lean_deg), NO_PLANE_DEG)
        widened = (radii != choice.radius_mm).any()
        return _judged(found, sides, choice.radius_mm, method, radii if widened else None, choice)

    def _widen(
        self, found: Estimates, places: Floats, method: NormalMethod, choice: RadiusChoice
    ) -> Floats:
        """Give places without a usable normal a wider one; return the radii (m,) used.

        At a rim the noise of a quadric is several times that in the middle; there a wider
        neighbourhood is taken where it errs less in all, by noise and lean.
        """
        radii = np.full(len(places), choice.radius_mm)
        for wider in RADII_MM[RADII_MM > choice.radius_mm * 1.01][:MAX_WIDER].tolist():
            refused = ~np.isin(found.flag, (0, ONE_SIDED, UNCERTAIN))
            shaky = (found.flag == UNCERTAIN) | ((found.flag == 0) & ~centred(found, radii))
            poor = np.flatnonzero(refused | (shaky & (wider <= choice.radii_mm.max(initial=0.0))))
            if not len(poor):
                break
            more = estimate(self._points, places[poor], wider, method, choice.noise_mm)
            before = np.hypot(found.sigma_deg[poor], choice.lean_at_deg(radii[poor]))
            after = np.hypot(more.sigma_deg, choice.lean_at_deg(np.array(wider)))
            usable = (more.flag == 0) | (more.flag == UNCERTAIN)
            better = usable & (refused[poor] | (after < before))
            found.replace(poor[better], more.select(better))
            radii[poor[better]] = wider
        return radii


def _judged(
    found: Estimates,
    sides: Floats,
    radius_mm: float,
    method: str,
    radii_mm: Floats | None,
    choice: RadiusChoice | None,
) -> Normals:
    """Return estimates turned to the outer side, with the names of what is wrong."""
    bare = (found.count < 3) | (np.linalg.norm(found.normals, axis=1) < 0.5)
    normals = np.where(bare[:, None], sides, found.normals)
    facing = np.einsum("ij,ij->i", normals, sides)
    normals = normals * np.where(facing < 0, -1.0, 1.0)[:, None]
    flag = np.where((found.flag == 0) & (np.abs(facing) < MIN_FACING), EDGE_ON, found.flag)
    return Normals(
        normals=readonly(normals),
        count=readonly(found.count),
        eigenvalues=readonly(found.eigenvalues),
        sigma_deg=readonly(np.where(bare, NO_PLANE_DEG, found.sigma_deg)),
        ok=readonly(flag == 0),
        radius_mm=radius_mm,
        method=method,
        refused={
            name: tuple(np.flatnonzero(flag == i).tolist())
            for i, name in enumerate(FLAGS)
            if i and (flag == i).any()
        },
        radii_mm=None if radii_mm is None else readonly(radii_mm),
        choice=choice,
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


@dataclass(frozen=True, slots=True, eq=False)
class ThinPlaces:
    """Places that another pass of the pointer would help, the worst first."""

    points_base: Floats  # (k, 3)
    places: Ints  # (k,) their numbers among the places that were asked about
    reasons: tuple[str, ...]  # keys of ``REASONS``
    times: Floats  # (k,) how many times as many points would do

    def __len__(self) -> int:
        return len(self.places)


def thin_places(
    normals: Normals, at: ArrayLike, *, max_sigma_deg: float = MAX_SIGMA_DEG
) -> ThinPlaces:
    """Return where ``normals`` are refused, served by a wider neighbourhood, or too uncertain.

    Args:
        normals: What ``NormalField.normals`` found.
        at: The places (m, 3) it was asked about.
        max_sigma_deg: Largest predicted error that is good enough.

    Raises:
        InvalidInputError: another number of places, or a bound that is not positive.
    """
    places = as_points(at, name="at")
    if len(places) != len(normals):
        raise InvalidInputError(f"{len(normals)} normals need as many places, not {len(places)}")
    if not 0.0 < max_sigma_deg < np.inf:
        raise InvalidInputError(f"max_sigma_deg must be positive, not {max_sigma_deg}")
    reasons = np.array(normals.flags, dtype=object)
    reasons[(reasons == "ok") & (normals.sigma_deg > max_sigma_deg)] = "uncertain"
    # the error falls with the root of the number of points
    times = np.clip((normals.sigma_deg / max_sigma_deg) ** 2, 1.0, MOST)
    if normals.radii_mm is not None:
        wide = normals.radii_mm > normals.radius_mm
        times = np.maximum(times, np.minimum((normals.radii_mm / normals.radius_mm) ** 2, MOST))
        reasons[(reasons == "ok") & wide] = "widened"
    times = np.where(np.isin(reasons, ("ok", "uncertain", "widened")), times, MOST)
    thin = np.flatnonzero(reasons != "ok")
    thin = thin[np.argsort(-times[thin], kind="stable")]
    return ThinPlaces(
        points_base=readonly(places[thin]),
        places=readonly(thin),
        reasons=tuple(str(reason) for reason in reasons[thin]),
        times=readonly(times[thin]),
    )
