"""How wrong the virtual tracker sees single markers: a smooth fixed field and white noise."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Bools, Floats, readonly
from rona_core.devices.settings import TrackerProfile
from rona_core.virtual.noise import rng

# Work volume in the frame `tracker`, whose z axis looks into it: a silo, domed towards the camera.
VOLUME_RADIUS_MM = 500.0
VOLUME_NEAR_MM = 1400.0  # distance from the camera
VOLUME_FAR_MM = 2400.0  # along z

TOTAL_RMS_MM = 0.35  # 3D, over the volume (Polaris specification, paper section IV)
WHITE_RMS_MM = 0.05  # 3D, repeatability (paper section IV)
DEPTH_TO_LATERAL = 3.0  # of both parts: triangulation is worst in depth
BIAS_LENGTH_MM = 400.0  # over which the field changes noticeably
WAVES = 48  # random plane waves that make up the field


def in_volume(points_tracker: ArrayLike) -> Bools:
    """Return which points (n, 3) lie in the work volume, (n,)."""
    p = np.asarray(points_tracker, dtype=np.float64)
    lateral = np.hypot(p[:, 0], p[:, 1])
    distance = np.sqrt((p**2).sum(axis=1))
    return (
        (lateral <= VOLUME_RADIUS_MM)
        & (distance >= VOLUME_NEAR_MM)
        & (p[:, 2] > 0.0)
        & (p[:, 2] <= VOLUME_FAR_MM)
    )


def sample_volume(n: int, generator: np.random.Generator) -> Floats:
    """Return n points (n, 3) spread evenly over the work volume, in ``tracker``."""
    kept: list[Floats] = []
    while sum(map(len, kept)) < n:
        box = generator.uniform(-1.0, 1.0, (2 * n + 16, 3))
        box[:, :2] *= VOLUME_RADIUS_MM
        box[:, 2] = (box[:, 2] + 1.0) / 2 * (VOLUME_FAR_MM - 1200.0) + 1200.0
        kept.append(box[in_volume(box)])
    return np.concatenate(kept)[:n]


@dataclass(frozen=True, slots=True, eq=False)
class MarkerError:
    """Error of one marker as a function of where it is, plus white noise; all in ``tracker``."""

    white_mm: Floats  # (3,) standard deviation per axis
    waves: Floats  # (w, 3) radians per mm
    phases: Floats  # (w,)
    amplitudes_mm: Floats  # (w, 3)

    def bias_mm(self, points_tracker: Floats) -> Floats:
        """Return the fixed error (n, 3) at points (n, 3); averaging does not remove it."""
        if not len(self.waves):
            return np.zeros_like(points_tracker)
        return np.cos(points_tracker @ self.waves.T + self.phases) @ self.amplitudes_mm

    def measure(self, points_tracker: Floats, white: Floats) -> Floats:
        """Return measured positions (n, 3); ``white`` (n, 3) are standard normal numbers."""
        return points_tracker + self.bias_mm(points_tracker) + white * self.white_mm


@lru_cache(maxsize=64)
def marker_error(profile: TrackerProfile, seed: int) -> MarkerError:
    """Return the error of one tracker; the field belongs to the device, so only the seed sets it.

    Profiles: ``ideal`` exact; ``white035`` 0.35 mm 3D RMS white and equal in all directions, no
    field; ``polaris`` 0.05 mm 3D RMS white plus a field, together 0.35 mm 3D RMS over the volume,
    both three times larger in depth than in either lateral direction.
    """
    none = np.zeros((0, 3))
    if profile == "ideal":
        return MarkerError(readonly(np.zeros(3)), none, np.zeros(0), none)
    if profile == "white035":
        each = np.full(3, TOTAL_RMS_MM / np.sqrt(3.0))
        return MarkerError(readonly(each), none, np.zeros(0), none)
    shares = np.array((1.0, 1.0, DEPTH_TO_LATERAL))
    shares /= np.linalg.norm(shares)  # 3D RMS 1
    generator = rng(seed, "tracker-bias", 0, 0)
    waves = generator.normal(0.0, 1.0 / BIAS_LENGTH_MM, (WAVES, 3))
    phases = generator.uniform(0.0, 2.0 * np.pi, WAVES)
    amplitudes = generator.normal(0.0, 1.0, (WAVES, 3))
    raw = MarkerError(np.zeros(3), waves, phases, amplitudes)
    rms = np.sqrt((raw.bias_mm(sample_volume(4000, generator)) ** 2).mean(axis=0))
    bias_rms_mm = np.sqrt(TOTAL_RMS_MM**2 - WHITE_RMS_MM**2)
    return MarkerError(
        readonly(WHITE_RMS_MM * shares),
        readonly(waves),
        readonly(phases),
        readonly(amplitudes * (bias_rms_mm * shares / rms)),
    )
