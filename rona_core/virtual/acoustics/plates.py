"""Virtual plates of bone and blocks of steel, to try probes on, and a caliper on the true bone."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import probe_model
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import LayerProfile
from rona_core.virtual.acoustics.medium import GEL, MEDIA, Medium, bone_medium
from rona_core.virtual.acoustics.probe import VirtualProbe, receiver_noise
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.world.world import NOMINAL, World

SHARES = (0.29, 0.42, 0.29)  # of table, diploe and table
TILT_RAD = 0.01  # rms of the probe against the bone
LIFT_MM = 0.2
RELIEF_MM, RELIEF_LENGTH_MM = 0.06, 12.0  # of the inner table, along the row of shots
PITCH_MM = 1.0
PERIOD_S = 0.02
STEEL = Material(5.9, 7.8, shear_mm_per_us=3.2)
PART_MM = 10.0  # the model counts the block as three layers of one material
CALIPER_SIGMA_MM = 0.1
GAUGE_SIGMA_MM, STEP_SIGMA_MM = 0.02, 0.003  # of a gauge plate's seat, and of its steps
COLLAR_SIGMA_MM, COLLAR_RAD = 0.1, 0.015  # of a collar's depth, and of its tilt about two axes
BEHIND_MM = 10.0  # rays start this far outside the place


def record_plate(
    settings: ProbeSettings, thickness_mm: float, kind: str, n: int, random: np.random.Generator
) -> tuple[AScanTrack, Floats, Floats]:
    """Return A-scans of a plate, the two-way time through it (n,) and the places (n, 3).

    Args:
        settings: Of the probe.
        thickness_mm: Mean of the plate.
        kind: Of the bone, one of ``MEDIA``.
        n: A-scans, in rows to and fro over a square.
        random: For texture, relief, tilts, lifts and noise.
    """
    probe, medium = probe_model(settings), MEDIA[kind]
    texture = int(random.integers(2**31))
    echo = EchoModel(probe, settings.excitation, medium, texture)
    side = int(np.ceil(np.sqrt(n)))
    row, column = np.divmod(np.arange(n), side)
    column = np.where(row % 2 == 0, column, side - 1 - column)
    places = PITCH_MM * np.column_stack((column, row, np.zeros(n)))
    waves = 2.0 * np.pi / RELIEF_LENGTH_MM * random.normal(0.0, 1.0, (2, 8))
    phases = random.uniform(0.0, 2.0 * np.pi, 8)
    noise = receiver_noise(settings, probe)
    tilts = random.normal(0.0, TILT_RAD / np.sqrt(2.0), (n, 2))
    lifts = random.normal(0.0, LIFT_MM, n)
    scans, bone_us = [], np.zeros(n)
    for i in range(n):
        rays = echo.ray_points_mm
        relief, slope = _relief(places[i, :2] + np.vstack((np.zeros((1, 2)), rays)), waves, phases)
        total = thickness_mm + relief
        table, diploe, inner = (share * total for share in SHARES)
        slow = 1.0 / medium.table.speed_mm_per_us, 1.0 / medium.diploe.speed_mm_per_us
        bone_us[i] = 2.0 * float((table[0] + inner[0]) * slow[0] + diploe[0] * slow[1])
        angle = np.full(len(rays), float(np.hypot(*tilts[i])))
        bent = medium.table.speed_mm_per_us / medium.gel.speed_mm_per_us * tilts[i]
        profile = LayerProfile(
            outer_mm=lifts[i] + rays @ tilts[i],
            table_mm=table[1:],
            diploe_mm=diploe[1:],
            inner_table_mm=inner[1:],
            hit=np.ones(len(rays), dtype=np.bool_),
            entries_skull=np.column_stack((places[i, :2] + rays, np.zeros(len(rays)))),
            outer_angle_rad=angle,
            inner_angle_rad=np.hypot(*(slope[1:] + bent).T),
        )
        rf = echo.trace(profile)
        rf = rf + random.normal(0.0, noise, len(rf))
        steps = 2.0 ** (probe.adc_bits - 1)
        kept = np.clip(np.rint(rf * steps) / steps, -1.0, 1.0 - 1.0 / steps)
        clipped = bool(np.abs(rf).max() >= 1.0)
        when = PERIOD_S * (i + 1)
        scans.append(AScan(when, readonly(kept), probe.sampling_mhz, probe.start_us, clipped))
    return AScanTrack.from_scans(scans), bone_us, places


def _relief(xy: Floats, waves: Floats, phases: Floats) -> tuple[Floats, Floats]:
    """Return height (n,) and slopes (n, 2) of the inner table's relief at places (n, 2)."""
    height = RELIEF_MM * np.sqrt(2.0 / len(phases))
    phase = xy @ waves + phases
    return height * np.sin(phase).sum(axis=1), height * np.cos(phase) @ waves.T


class SteelFace:
    """A plane z = 0 with steel behind it; asked like any specimen."""

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return distances (n, 4) along rays to the face and to three planes in the steel."""
        depths = PART_MM * np.arange(4)
        return (depths - origins_skull[:, 2:]) / directions_skull[:, 2:]


def steel_medium() -> Medium:
    """Return gel on steel, without texture and without another side."""
    return Medium(
        table=STEEL,
        diploe=STEEL,
        brain=STEEL,
        ramp_mm=0.0,
        outer_roughness_mm=0.0,
        inner_roughness_mm=0.0,
        speckle=0.0,
    )


def record_block(
    settings: ProbeSettings, n: int, seed: int, ordinal: int = 0, world: World = NOMINAL
) -> AScanTrack:
    """Return ``n`` A-scans of the block with the probe set down on it, perpendicular.

    The line is as warm as the settings say, and gel fills the film that always remains.
    """
    return _on_steel(settings, n, (seed, ordinal), world, Pose.identity())


def _on_steel(
    settings: ProbeSettings, n: int, capture: tuple[int, int], world: World, T_skull_probe: Pose
) -> AScanTrack:
    """Return ``n`` A-scans of a probe on steel; ``capture`` is seed and ordinal of its noise."""
    clock, (seed, ordinal) = CaptureClock(), capture
    medium = replace(
        steel_medium(),
        gel=replace(GEL, speed_mm_per_us=world.gel_speed_mm_per_us),
        film_mm=world.film_mm,
    )
    probe = VirtualProbe(
        clock, lambda times: T_skull_probe.repeated(len(times)), SteelFace(), medium, world=world
    )
    probe.begin(settings, seed, ordinal)
    return _recorded(probe, clock, n)


def _recorded(probe: VirtualProbe, clock: CaptureClock, n: int) -> AScanTrack:
    """Return n A-scans at a steady pace; the probe is closed then."""
    scans: list[AScan] = []
    for number in range(n):
        clock.wait_until(PERIOD_S * (number + 1))
        scans.append(probe.acquire())
    probe.close()
    return AScanTrack.from_scans(scans)


Teach = Callable[[VirtualScene], tuple[tuple[str, ...], Floats]]


class VirtualBench:
    """Measures on the true bone, with the error of a caliper; satisfies ``devices.Bench``."""

    def __init__(self, scene: VirtualScene, teach: Teach | None = None) -> None:
        """Measure in this scene; ``teach`` is a robot's tip led into its landmarks."""
        self._teach = teach
        self.begin(scene, 0)

    def begin(self, scene: VirtualScene, ordinal: int) -> None:
        """Get ready for capture number ``ordinal``."""
        self._scene, self._ordinal, self._block = scene, ordinal, 0

    def measure_thickness(self, places_base: Floats, axes_base: Floats) -> tuple[Floats, float]:
        """Return thicknesses (n,) of the bone at places along inward axes (n, 3), and their sigma.

        Raises:
            DeviceError: a place where a caliper finds no bone to grip.
        """
        T_skull_base = self._scene.T_base_skull.inv()
        starts = T_skull_base @ (places_base - BEHIND_MM * axes_base)
        found = self._scene.specimen.layers(starts, T_skull_base.rotate(axes_base))
        true_mm = found[:, 3] - found[:, 0]
        if not np.isfinite(true_mm).all():
            row = int(np.flatnonzero(~np.isfinite(true_mm))[0])
            raise DeviceError(f"there is no bone at place {row + 1} that a caliper could grip")
        random = rng(self._scene.seed, "caliper", self._ordinal, 0)
        return true_mm + random.normal(0.0, CALIPER_SIGMA_MM, len(true_mm)), CALIPER_SIGMA_MM

    def record_reference_block(
        self, settings: ProbeSettings, temperature_c: float, n: int
    ) -> AScanTrack:
        """Return ``n`` A-scans of the probe at rest on a steel block, its line this warm."""
        warm = replace(settings, line_temperature_c=temperature_c)
        self._block += 1
        ordinal = 1000 * self._ordinal + self._block  # noise of its own for each temperature
        return record_block(warm, n, self._scene.seed, ordinal, self._scene.world)

    def taught_landmarks(self) -> tuple[tuple[str, ...], Floats]:
        """Return the landmarks that the robot's tip was led into.

        Raises:
            DeviceError: it reaches too few, or there is no robot beside this bench.
        """
        if self._teach is None:
            raise DeviceError("there is no robot beside this bench to touch landmarks with")
        return self._teach(self._scene)

    def record_gauge_plate(
        self, settings: ProbeSettings, depth_mm: float, n: int
    ) -> tuple[AScanTrack, float]:
        """Return ``n`` A-scans of the probe under a gauge plate, and the tolerance of its depth."""
        world, seed = self._scene.world, self._scene.seed
        self._block += 1
        seat = rng(seed, "gauge plate", self._ordinal, 0).normal(0.0, GAUGE_SIGMA_MM)
        step = rng(seed, "gauge step", self._ordinal, self._block).normal(0.0, STEP_SIGMA_MM)
        pressed = Pose.from_translation((0.0, 0.0, depth_mm + seat + step))
        capture = seed, 1000 * self._ordinal + self._block
        track = _on_steel(settings, n, capture, world, pressed @ world.clamping)
        return track, GAUGE_SIGMA_MM

    def record_on_bone(
        self, settings: ProbeSettings, places_base: Floats, axes_base: Floats, depth_mm: float
    ) -> AScanTrack:
        """Return an A-scan at each place (n, 3) by the probe in its collar, along its axis (n, 3).

        Raises:
            DeviceError: there is no bone at a place.
        """
        scene, n = self._scene, len(places_base)
        self._block += 1
        random = rng(scene.seed, "collar", self._ordinal, self._block)
        T_skull_base = scene.T_base_skull.inv()
        axes = T_skull_base.rotate(axes_base) + random.normal(0.0, COLLAR_RAD, (n, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        starts = T_skull_base @ (places_base - BEHIND_MM * axes_base)
        way_mm = scene.specimen.layers(starts, axes)[:, 0]
        if not np.isfinite(way_mm).all():
            row = int(np.flatnonzero(~np.isfinite(way_mm))[0])
            raise DeviceError(f"there is no bone at place {row + 1} that the probe could stand on")
        pressed_mm = depth_mm + random.normal(0.0, COLLAR_SIGMA_MM, n)
        points = starts + (way_mm + pressed_mm)[:, None] * axes
        faces = Path5D(points, axes).Ts_base_probe(0.0)
        clock = CaptureClock()
        probe = VirtualProbe(
            clock,
            lambda times: faces.select(np.rint(times / PERIOD_S).astype(np.int64) - 1),
            scene.specimen,
            bone_medium(scene.world),
            world=scene.world,
        )
        probe.begin(settings, scene.seed, 1000 * self._ordinal + self._block)
        return _recorded(probe, clock, n)
