"""The virtual probe: fires on the true skull at the true pose, with the noise of its receiver."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from rona_core.devices.protocols import Clock
from rona_core.devices.samples import AScan
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Pose
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
        if self._closed:
            raise DeviceError("the probe is closed; open a new one")
        time_s = self._clock.now()
        rf = self._noiseless(self._T_skull_probe())
        index = round(time_s * MICROSECONDS)
        random = np.random.default_rng((self._seed, PROBE_STREAM, self._ordinal, index))
        rf = rf + random.normal(0.0, self._noise, len(rf))
        steps = 2.0 ** (self._model.adc_bits - 1)
        rf, clipped = np.rint(rf * steps) / steps, bool(np.abs(rf).max() >= 1.0)
        rf = np.clip(rf, -1.0, 1.0 - 1.0 / steps)
        return AScan(time_s, readonly(rf), self._model.sampling_mhz, self._model.start_us, clipped)

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        self._closed = True

    def _noiseless(self, T_skull_probe: Pose) -> Floats:
        profile = self.profile(T_skull_probe)
        return self._echo.lifted() if profile is None else self._echo.trace(profile)

    def profile(self, T_skull_probe: Pose) -> LayerProfile | None:
        """Return what each ray of the beam meets from this pose; None where the face is in air."""
        axis = T_skull_probe.rotation[:, 2]
        flat = np.column_stack((self._cast_mm, np.zeros(len(self._cast_mm))))
        face_skull = T_skull_probe @ flat
        directions = np.broadcast_to(axis, face_skull.shape)
        found = self._specimen.layers(face_skull - RETREAT_MM * axis, directions)
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
