"""The virtual probe: fires on the true skull at the true pose, with the noise of its receiver."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from rona_core.devices.protocols import Clock
from rona_core.devices.samples import AScan
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.ultrasound.probe.beam import FACE_OVER_APERTURE
from rona_core.ultrasound.probe.probe_model import probe_model, warmed
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import LayerProfile
from rona_core.virtual.acoustics.medium import Medium

MOST_ANGLE_RAD = 0.5  # steeper places of a boundary count as this steep
RETREAT_MM = 12.0  # rays start this far before the face, which may lie inside the bone
SLOPE_STEP_MM = 0.05  # between the places whose depths give a slope
CAST_RINGS = 3  # hexagonal rings of cast rays: 37; the beam's rays are interpolated from them
PROBE_STREAM = 0x9B0BE  # names the probe's share of the session's seed
MICROSECONDS = 1e6


class Layered(Protocol):
    """A specimen that knows the boundaries of its bone."""

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return distances (n, 4) along rays to the outer boundary, diploe, inner table, inner.

        Infinite where a ray misses.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Firing:
    """When the probe fired, and where it was."""

    time_s: float
    pose: Pose  # T_skull_probe


class VirtualProbe:
    """An A-mode probe that looks at the ground truth and at nothing else."""

    def __init__(
        self,
        clock: Clock,
        T_skull_probe: Callable[[], Pose],
        specimen: Layered,
        medium: Medium | None = None,
    ) -> None:
        self._clock, self._T_skull_probe, self._specimen = clock, T_skull_probe, specimen
        self._medium = medium if medium is not None else Medium()
        self._closed = False
        self.begin(ProbeSettings(), seed=0, ordinal=0)

    @property
    def medium(self) -> Medium:
        """Gel and bone as they are: ground truth."""
        return self._medium

    def begin(self, settings: ProbeSettings, seed: int, ordinal: int) -> None:
        """Configure the probe for capture number ``ordinal`` of a session with this seed."""
        self._model = probe_model(settings)
        self._seed, self._ordinal = seed, ordinal
        self._pending: list[_Firing] = []
        line = warmed(self._model.line, settings.line_temperature_c)
        self._echo = EchoModel(self._model, settings.excitation, self._medium, seed, line=line)
        radius_mm = FACE_OVER_APERTURE * self._model.aperture_radius_mm
        self._cast_mm = hexagon(radius_mm, CAST_RINGS)
        self._rays = _Interpolation(self._cast_mm, self._echo.ray_points_mm)
        # noise is white; its share in the -6 dB band has the rms that the setting asks for
        band = self._model.bandwidth * self._model.centre_mhz / (self._model.sampling_mhz / 2.0)
        in_band = self._model.front_share * 10.0 ** (-settings.front_snr_db / 20.0)
        self._noise = in_band / np.sqrt(band)

    def acquire(self) -> AScan:
        """Fire once, now, and return the trace.

        Raises:
            DeviceError: the probe is closed.
        """
        return self._receive([self._fire()])[0]

    def fire(self) -> None:
        """Fire once, now, and keep the trace until it is collected; errors as in `acquire`."""
        self._pending.append(self._fire())

    def collect(self) -> list[AScan]:
        """Return the traces that were kept since the last call, in their order."""
        firings, self._pending = self._pending, []
        return self._receive(firings)

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        self._closed = True

    def _fire(self) -> _Firing:
        if self._closed:
            raise DeviceError("the probe is closed; open a new one")
        return _Firing(self._clock.now(), self._T_skull_probe())

    def _receive(self, firings: list[_Firing]) -> list[AScan]:
        """Return the traces of some firings, with noise and as the converter has them."""
        if not firings:
            return []
        model, steps = self._model, 2.0 ** (self._model.adc_bits - 1)
        scans = []
        noiseless = self._noiseless([firing.pose for firing in firings])
        for firing, rf in zip(firings, noiseless, strict=True):
            index = round(firing.time_s * MICROSECONDS)
            random = np.random.default_rng((self._seed, PROBE_STREAM, self._ordinal, index))
            rf = np.rint((rf + random.normal(0.0, self._noise, len(rf))) * steps) / steps
            clipped = bool(np.abs(rf).max() >= 1.0)
            rf = readonly(np.clip(rf, -1.0, 1.0 - 1.0 / steps))
            scans.append(AScan(firing.time_s, rf, model.sampling_mhz, model.start_us, clipped))
        return scans

    def _noiseless(self, Ts_skull_probe: Sequence[Pose]) -> Floats:
        """Return the traces (n, samples) without noise; in the air they are the face's own."""
        profiles = self.profiles(Ts_skull_probe)
        coupled = [i for i, profile in enumerate(profiles) if profile is not None]
        rf = np.tile(self._echo.lifted(), (len(profiles), 1))
        rf[coupled] = self._echo.traces([profile for profile in profiles if profile is not None])
        return rf

    def profiles(self, Ts_skull_probe: Sequence[Pose]) -> list[LayerProfile | None]:
        """Return what the rays of the beam meet from each pose; None where the face is in air."""
        n, flat = len(self._cast_mm), np.column_stack((self._cast_mm, np.zeros(len(self._cast_mm))))
        poses = Poses.stack(Ts_skull_probe)
        axes = poses.rotations[:, :, 2]
        starts = (poses.map_points(flat) - RETREAT_MM * axes[:, None]).reshape(-1, 3)
        found = self._specimen.layers(starts, np.repeat(axes, n, axis=0)).reshape(-1, n, 4)
        return [self._profile(pose, depths) for pose, depths in zip(poses, found, strict=True)]

    def _profile(self, T_skull_probe: Pose, found: Floats) -> LayerProfile | None:
        """Return the layers under the rays of the beam from those under the cast rays (c, 4)."""
        outer = found[:, 0] - RETREAT_MM
        hit: Bools = np.asarray(np.isfinite(found).all(axis=1), dtype=np.bool_)
        if not hit[0] or abs(outer[0]) > self._model.compliance_mm:  # ray 0 is the axis
            return None
        depths = np.where(hit[:, None], found - RETREAT_MM, found[hit].mean(axis=0) - RETREAT_MM)
        outer, diploe, table, inner = (self._rays.values @ depths).T
        outer_rad, inner_rad = self._angles(self._rays.slopes @ depths[:, (0, 3)])
        return LayerProfile(
            outer_mm=outer,
            table_mm=np.maximum(diploe - outer, 0.0),
            diploe_mm=np.maximum(table - diploe, 0.0),
            inner_table_mm=np.maximum(inner - table, 0.0),
            hit=hit[self._rays.nearest],
            entries_skull=T_skull_probe @ np.column_stack((self._echo.ray_points_mm, outer)),
            outer_angle_rad=outer_rad,
            inner_angle_rad=inner_rad,
        )

    def _angles(self, slopes: Floats) -> tuple[Floats, Floats]:
        """Return the angles of incidence (n,) on outer and inner boundary from slopes (2, n, 2).

        In the bone the wave travels as refraction sends it; for such small angles, these add.
        """
        outer, inner = slopes[..., 0], slopes[..., 1]
        ratio = self._medium.table.speed_mm_per_us / self._medium.gel.speed_mm_per_us
        at_inner = np.hypot(*(inner - outer + ratio * outer))
        limit = np.tan(MOST_ANGLE_RAD)
        at_outer = np.hypot(*outer)
        return np.arctan(np.minimum(at_outer, limit)), np.arctan(np.minimum(at_inner, limit))


def hexagon(radius_mm: float, rings: int) -> Floats:
    """Return a point at the centre and ``rings`` rings of 6, 12, ... around it, shape (n, 2)."""
    points = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        angle = 2.0 * np.pi * (np.arange(6 * ring) + 0.5 * (ring % 2)) / (6 * ring)
        points.append(radius_mm * ring / rings * np.stack((np.cos(angle), np.sin(angle)), axis=1))
    return np.concatenate(points)


class _Interpolation:
    """From depths at the cast rays (c,) to depths and slopes at the rays of the beam (n,)."""

    def __init__(self, cast_mm: Floats, rays_mm: Floats) -> None:
        thin_plate = RBFInterpolator(cast_mm, np.eye(len(cast_mm)))
        self.values: Floats = thin_plate(rays_mm)  # (n, c)
        steps = SLOPE_STEP_MM * np.eye(2)
        self.slopes: Floats = np.stack(  # (2, n, c) along x and y of the probe
            [thin_plate(rays_mm + h) - thin_plate(rays_mm - h) for h in steps]
        ) / (2.0 * SLOPE_STEP_MM)
        self.nearest: Ints = np.asarray(KDTree(cast_mm).query(rays_mm)[1], dtype=np.int64)
