"""Marker error of the virtual tracker: a smooth fixed field and white noise.

Triangulation error of a stereo camera: how it grows with depth over a measuring volume. For
parallel cameras of focal length f and baseline b that find image points to s pixels, triangulation
gives, at depth z,

    lateral:  z s / (sqrt(2) f)          depth:  sqrt(2) z^2 s / (f b)

so that depth over lateral is 2 z / b. Real trackers do better in depth than their housing suggests;
therefore the ratio is chosen, and b is what belongs to it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.settings import TrackerProfile, TrackerSettings
from rona_core.devices.trackers import SILO, VOLUMES, Volume
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.virtual.noise import rng

GRID = 48  # nodes a side of the grid that integrates over a volume


@dataclass(frozen=True, slots=True)
class Moments:
    """Root mean squares over a volume, evenly spread."""

    z_mm: float  # of the depth
    z2_mm2: float  # of its square

    def growth(self, points_tracker: Floats) -> Floats:
        """Return how the error goes with the place (n, 3): each axis has RMS 1 over the volume."""
        z = points_tracker[:, 2]
        lateral = z / self.z_mm
        return np.stack((lateral, lateral, z * z / self.z2_mm2), axis=1)


@lru_cache(maxsize=8)
def moments_of(volume: Volume) -> Moments:
    """Return the moments of a volume."""
    z = volume_grid(volume)[:, 2]
    return Moments(float(np.sqrt((z**2).mean())), float(np.sqrt((z**4).mean())))


@lru_cache(maxsize=4)
def volume_grid(volume: Volume, nodes: int = GRID) -> Floats:
    """Return points (n, 3) on a regular grid that fill a volume evenly."""
    half_x, half_y, low, high = volume.box()
    middles = (np.arange(nodes) + 0.5) / nodes
    x, y, z = (a.ravel() for a in np.meshgrid(middles, middles, middles, indexing="ij"))
    points = np.stack(
        ((2.0 * x - 1.0) * half_x, (2.0 * y - 1.0) * half_y, low + z * (high - low)), axis=1
    )
    return readonly(points[volume.contains(points)])


BIAS_LENGTH_MM = 400.0  # over which the field changes noticeably
WAVES = 48  # random plane waves that make up the field
FIELD_GRID = 36  # nodes a side of the grid that the field is scaled on


@dataclass(frozen=True, slots=True)
class Spec:
    """3D RMS errors of a profile over its volume."""

    total_mm: float  # white noise and field together
    white_mm: float
    isotropic: bool = False  # equal in all directions and everywhere


SPECS: dict[TrackerProfile, Spec] = {
    "ideal": Spec(0.0, 0.0, isotropic=True),
    "polaris": Spec(0.35, 0.05),  # Polaris specification, paper section IV
    "white035": Spec(0.35, 0.35, isotropic=True),
    "spectra": Spec(0.25, 0.06),  # volume figure of its maker; the white part is a choice
    "vega": Spec(0.12, 0.03),  # likewise
}


def in_volume(points_tracker: ArrayLike, profile: TrackerProfile = "polaris") -> Bools:
    """Return which points (n, 3) lie in the work volume, (n,)."""
    return VOLUMES[profile].contains(points_tracker)


def sample_volume(n: int, generator: np.random.Generator, volume: Volume = SILO) -> Floats:
    """Return n points (n, 3) spread evenly over a work volume, in ``tracker``."""
    half_x, half_y, low, high = volume.box()
    kept: list[Floats] = []
    while sum(map(len, kept)) < n:
        box = generator.uniform(-1.0, 1.0, (2 * n + 16, 3))
        box[:, 0] *= half_x
        box[:, 1] *= half_y
        box[:, 2] = (box[:, 2] + 1.0) / 2 * (high - low) + low
        kept.append(box[volume.contains(box)])
    return np.concatenate(kept)[:n]


@dataclass(frozen=True, slots=True, eq=False)
class MarkerError:
    """Error of one marker as a function of where it is, plus white noise; all in ``tracker``."""

    white_mm: Floats  # (3,) standard deviation per axis, RMS over the volume
    waves: Floats  # (w, 3) radians per mm
    phases: Floats  # (w,)
    amplitudes_mm: Floats  # (w, 3)
    moments: Moments | None = None  # how both grow with the distance; None: they do not

    def bias_mm(self, points_tracker: Floats) -> Floats:
        """Return the fixed error (n, 3) at points (n, 3); averaging does not remove it."""
        if not len(self.waves):
            return np.zeros_like(points_tracker)
        waves = points_tracker @ self.waves.T  # in place: of a whole volume it is large
        waves += self.phases
        field = np.cos(waves, out=waves) @ self.amplitudes_mm
        return field if self.moments is None else field * self.moments.growth(points_tracker)

    def sigmas_mm(self, points_tracker: Floats) -> Floats:
        """Return the standard deviations (n, 3) of the white noise at points (n, 3)."""
        if self.moments is None:
            return np.broadcast_to(self.white_mm, points_tracker.shape)
        return self.white_mm * self.moments.growth(points_tracker)

    def measure(self, points_tracker: Floats, white: Floats, share: float = 1.0) -> Floats:
        """Return measured positions (n, ..., 3), with a share of the error.

        ``white`` (n, ..., 3) are standard normal numbers. What a marker that keeps still is off by
        is computed once: the base never moves, the robot stands while the hand moves.
        """
        axes = tuple(range(1, points_tracker.ndim))
        fresh = np.append(True, (points_tracker[1:] != points_tracker[:-1]).any(axis=axes))
        places, of_row = points_tracker[fresh], np.cumsum(fresh) - 1
        flat = places.reshape(-1, 3)
        bias = self.bias_mm(flat).reshape(places.shape)[of_row]
        noise = white * self.sigmas_mm(flat).reshape(places.shape)[of_row]
        if share != 1.0:
            return points_tracker + share * (bias + noise)
        return points_tracker + bias + noise


def marker_error(settings: TrackerSettings, seed: int) -> MarkerError:
    """Return the error of one tracker; the field belongs to the device, so only the seed draws it.

    ``ideal`` is exact and ``white035`` 0.35 mm 3D RMS white, equal in all directions, no field.
    The others have white noise and a field, together the figure of the profile as 3D RMS over its
    volume, both larger in depth than laterally by the depth ratio. With ``stereo`` they grow with
    the distance from the cameras.
    """
    return _marker_error(settings.profile, settings.stereo, settings.depth_ratio, seed)


@lru_cache(maxsize=64)
def _marker_error(
    profile: TrackerProfile, stereo: bool, depth_ratio: float, seed: int
) -> MarkerError:
    spec, volume, none = SPECS[profile], VOLUMES[profile], np.zeros((0, 3))
    if spec.isotropic:
        each = np.full(3, spec.white_mm / np.sqrt(3.0))
        return MarkerError(readonly(each), none, np.zeros(0), none)
    shares = np.array((1.0, 1.0, depth_ratio))
    shares /= np.linalg.norm(shares)  # 3D RMS 1
    generator = rng(seed, "tracker-bias", 0, 0)
    waves = generator.normal(0.0, 1.0 / BIAS_LENGTH_MM, (WAVES, 3))
    phases = generator.uniform(0.0, 2.0 * np.pi, WAVES)
    amplitudes = generator.normal(0.0, 1.0, (WAVES, 3))
    moments = moments_of(volume) if stereo else None
    places = volume_grid(volume, FIELD_GRID) if stereo else sample_volume(4000, generator, volume)
    raw = MarkerError(np.zeros(3), waves, phases, amplitudes, moments)
    rms = np.sqrt((raw.bias_mm(places) ** 2).mean(axis=0))
    bias_rms_mm = np.sqrt(spec.total_mm**2 - spec.white_mm**2)
    return MarkerError(
        readonly(spec.white_mm * shares),
        readonly(waves),
        readonly(phases),
        readonly(amplitudes * (bias_rms_mm * shares / rms)),
        moments,
    )
