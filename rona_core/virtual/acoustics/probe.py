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
from rona_core.geometry.pose import Poses
from rona_core.ultrasound.probe.beam import FACE_OVER_APERTURE
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model
from rona_core.virtual.acoustics.delay_line import LINE_N_PER_MM, SHEAR_N_PER_MM, TrueLine
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import LayerProfile
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.world.world import NOMINAL, World

MOST_ANGLE_RAD = 0.5  # steeper places of a boundary count as this steep
MOST_BENT = 0.2  # share by which bent waves have a longer way, at most
RETREAT_MM = 12.0  # rays start this far before the face, which may lie inside the bone
SLOPE_STEP_MM = 0.05  # between the places whose depths give a slope
CAST_RINGS = 3  # hexagonal rings of cast rays: 37; the beam's rays are interpolated from them
PROBE_STREAM = 0x9B0BE  # names the probe's share of the session's seed
MICROSECONDS = 1e6
REPEATED = 0.03  # share of a shot's noise that is locked to the clock, so that no average lowers it


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
        Ts_skull_probe: Callable[[Floats], Poses],
        specimen: Layered,
        medium: Medium | None = None,
        *,
        world: World = NOMINAL,
        sliding: Callable[[Floats], Floats] | None = None,
    ) -> None:
        """Look at a specimen.

        Args:
            clock: Time of the capture.
            Ts_skull_probe: Returns where the probe really was at times (n,) of the capture that
                have gone by.
            specimen: The bone.
            medium: Gel and what the bone is made of; None: nominal.
            world: What line and crystal really are.
            sliding: Returns the directions (n, 3) in ``skull`` in which the face slid at times
                (n,), 0 at rest; None: it never does.
        """
        self._clock, self._Ts_skull_probe, self._specimen = clock, Ts_skull_probe, specimen
        self._medium = medium if medium is not None else Medium()
        self._world, self._sliding = world, sliding
        self._closed = False
        self._prepared: tuple[ProbeSettings, int] | None = None
        self.begin(ProbeSettings(), seed=0, ordinal=0)

    @property
    def medium(self) -> Medium:
        """Gel and bone as they are: ground truth."""
        return self._medium

    def begin(self, settings: ProbeSettings, seed: int, ordinal: int) -> None:
        """Configure the probe for capture number ``ordinal`` of a session with this seed."""
        self._ordinal = ordinal
        self._pending: list[float] = []  # times of the firings that were not collected yet
        if self._prepared != (settings, seed):
            self._prepare(settings, seed)
            self._prepared = settings, seed

    def _prepare(self, settings: ProbeSettings, seed: int) -> None:
        """Prepare what all captures of a session share while the settings stay."""
        self._model, self._seed = probe_model(settings), seed
        self._line = TrueLine(self._model, settings.line_temperature_c, self._world)
        true = self._line.probe
        self._echo = EchoModel(self._model, settings.excitation, self._medium, seed, true=true)
        radius_mm = FACE_OVER_APERTURE * self._model.aperture_radius_mm
        self._cast_mm = hexagon(radius_mm, CAST_RINGS)
        self._rays = _Interpolation(self._cast_mm, self._echo.ray_points_mm)
        self._noise = receiver_noise(settings, self._model)
        medium = self._medium
        self._bone_over_gel = medium.table.speed_mm_per_us / medium.gel.speed_mm_per_us

    def acquire(self) -> AScan:
        """Fire once, now, and return the trace.

        Raises:
            DeviceError: the probe is closed.
        """
        return self._receive([self._fire_s()])[0]

    def fire(self) -> None:
        """Fire once, now, and keep the trace until it is collected; errors as in `acquire`."""
        self._pending.append(self._fire_s())

    def collect(self) -> list[AScan]:
        """Return the traces that were kept since the last call, in their order."""
        fired_s, self._pending = self._pending, []
        return self._receive(fired_s)

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        self._closed = True

    def _fire_s(self) -> float:
        if self._closed:
            raise DeviceError("the probe is closed; open a new one")
        return self._clock.now()

    def _receive(self, fired_s: list[float]) -> list[AScan]:
        """Return the traces of firings at some times, with noise and as the converter has them."""
        if not fired_s:
            return []
        model, steps = self._model, 2.0 ** (self._model.adc_bits - 1)
        scans = []
        for time_s, rf in zip(fired_s, self._noiseless(np.array(fired_s)), strict=True):
            index = round(time_s * MICROSECONDS)
            random = np.random.default_rng((self._seed, PROBE_STREAM, self._ordinal, index))
            rf = rf + random.normal(0.0, self._noise, len(rf))
            rf *= steps
            np.rint(rf, out=rf)
            rf /= steps
            clipped = bool(rf.max() >= 1.0 or rf.min() <= -1.0)
            if clipped:
                np.clip(rf, -1.0, 1.0 - 1.0 / steps, out=rf)
            scans.append(AScan(time_s, readonly(rf), model.sampling_mhz, model.start_us, clipped))
        return scans

    def _noiseless(self, times_s: Floats) -> Floats:
        """Return the traces (n, samples) without noise; in the air they are the face's own."""
        profiles = self.profiles(self._sheared(times_s))
        coupled = [i for i, profile in enumerate(profiles) if profile is not None]
        touching = [profile for profile in profiles if profile is not None]
        late_us = None
        if self._line.varies and touching:
            pressed_mm = -np.array([profile.outer_mm[0] for profile in touching])
            late_us = self._line.late_us(times_s[coupled], pressed_mm)
        traces = self._echo.traces(touching, late_us)
        if len(touching) == len(profiles):
            return traces
        rf = np.tile(self._echo.lifted(), (len(profiles), 1))
        rf[coupled] = traces
        return rf

    def _sheared(self, times_s: Floats) -> Poses:
        """Return where the faces are: friction holds them back as far as the line gives way."""
        poses, friction = self._Ts_skull_probe(times_s), self._world.friction
        if friction == 0.0 or self._sliding is None:
            return poses
        axes = poses.rotations[:, :, 2]
        starts = poses @ np.array((0.0, 0.0, -RETREAT_MM))
        gap_mm = self._specimen.layers(starts, axes)[:, 0] - RETREAT_MM
        pressed_mm = np.where(np.isfinite(gap_mm), np.maximum(-gap_mm, 0.0), 0.0)
        back_mm = friction * LINE_N_PER_MM / SHEAR_N_PER_MM * pressed_mm
        shifts = -back_mm[:, None] * self._sliding(times_s)
        return Poses.unchecked(poses.rotations, poses.translations + shifts)

    def profiles(self, Ts_skull_probe: Poses) -> list[LayerProfile | None]:
        """Return what the rays of the beam meet from each pose; None where the face is in air."""
        n, flat = len(self._cast_mm), np.column_stack((self._cast_mm, np.zeros(len(self._cast_mm))))
        axes = Ts_skull_probe.rotations[:, :, 2]
        starts = Ts_skull_probe.map_points(flat) - RETREAT_MM * axes[:, None]
        rays = starts.reshape(-1, 3), np.repeat(axes, n, axis=0)
        found = self._specimen.layers(*rays).reshape(-1, n, 4)
        hit: Bools = np.asarray(np.isfinite(found).all(axis=2), dtype=np.bool_)
        gaps_mm = found[:, 0, 0] - RETREAT_MM  # ray 0 is the axis
        touching = hit[:, 0] & (np.abs(gaps_mm) <= self._model.compliance_mm)
        found, hit = found[touching], hit[touching]
        for i in np.flatnonzero(~hit.all(axis=1)).tolist():
            found[i, ~hit[i]] = found[i, hit[i]].mean(axis=0)
        depths = found - RETREAT_MM
        profiles = iter(self._profiles(Ts_skull_probe.select(touching), depths, hit))
        return [next(profiles) if touches else None for touches in touching.tolist()]

    def _profiles(self, Ts_skull_probe: Poses, depths_mm: Floats, hit: Bools) -> list[LayerProfile]:
        """Return the layers under the rays of the beam at n poses, from those of the cast rays.

        Args:
            Ts_skull_probe: Where the probe is (n,).
            depths_mm: Of the four boundaries from the face, at each cast ray (n, c, 4).
            hit: Which cast rays (n, c) meet the bone.
        """
        outer, diploe, table, inner = np.moveaxis(self._rays.values @ depths_mm, 2, 0)
        slopes = self._rays.slopes[:, None] @ depths_mm[:, :, (0, 3)]
        outer_rad, inner_rad = self._angles(slopes)
        longer = 1.0 + bent_share(slopes[..., 0], slopes[..., 1], self._bone_over_gel)
        on_face = np.broadcast_to(self._echo.ray_points_mm, (*outer.shape, 2))
        entries = np.concatenate((on_face, outer[:, :, None]), axis=2)
        turned = entries @ np.swapaxes(Ts_skull_probe.rotations, 1, 2)
        columns = (
            outer,
            longer * np.maximum(diploe - outer, 0.0),
            longer * np.maximum(table - diploe, 0.0),
            longer * np.maximum(inner - table, 0.0),
            hit[:, self._rays.nearest],
            turned + Ts_skull_probe.translations[:, None],
            outer_rad,
            inner_rad,
        )
        return [LayerProfile(*fields) for fields in zip(*columns, strict=True)]

    def _angles(self, slopes: Floats) -> tuple[Floats, Floats]:
        """Return angles of incidence on outer and inner boundary (...) from slopes (2, ..., 2).

        In the bone the wave travels as refraction sends it; for such small angles, these add.
        """
        outer, inner = slopes[..., 0], slopes[..., 1]
        at_inner = np.hypot(*(inner - outer + self._bone_over_gel * outer))
        limit = np.tan(MOST_ANGLE_RAD)
        at_outer = np.hypot(*outer)
        return np.arctan(np.minimum(at_outer, limit)), np.arctan(np.minimum(at_inner, limit))


def bent_share(outer: Floats, inner: Floats, bone_over_gel: float) -> Floats:
    """Return by how much longer (...) the way through bone is for waves that it bends.

    A wave along the axis goes on at (n - 1) s to it, where the outer boundary slopes by s, and n is
    the ratio of speeds. It meets the inner boundary aside, and its phase there is that of the
    axis to second order in the slopes.

    Args:
        outer: Slopes of the outer boundary (2, ...) across the axis.
        inner: Slopes of the inner boundary (2, ...).
        bone_over_gel: Ratio of speeds.
    """
    aside = (bone_over_gel - 1.0) * outer
    share = np.sum(aside * (inner + aside) - 0.5 * aside**2, axis=0)
    return np.clip(share, -MOST_BENT, MOST_BENT)


def receiver_noise(settings: ProbeSettings, model: ProbeModel) -> float:
    """Return the RMS of the white noise of an A-scan, over full scale.

    Its share in the -6 dB band is as set for one shot, and falls with the root of the number of
    shots that are averaged, down to what every shot repeats.
    """
    band = model.bandwidth * model.centre_mhz / (model.sampling_mhz / 2.0)
    one = model.front_share * 10.0 ** (-settings.front_snr_db / 20.0) / np.sqrt(band)
    new = 1.0 / settings.shots
    return float(one * np.sqrt(new + REPEATED**2 * (1.0 - new)))


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
