"""Motion of a hand-held tool: tip and shaft as smooth functions of time, with tremor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats, Vector3, readonly
from rona_core.geometry.pose import Pose, Poses

UP: Vector3 = readonly(np.array((0.0, 1.0, 0.0)))  # along the shaft of a tool made as drawn
SAMPLES_HZ = 200.0  # of the curves a motion is made of; the splines between follow to a micrometre
TREMOR_HZ = (6.0, 12.0)  # physiological tremor
TREMOR_MM = 0.2  # RMS in each direction along the surface: 0.3 mm in both
WANDER_HZ = (0.2, 1.0)  # slow drift of an aimed movement
WANDER_MM = 0.25
TILT_HZ = (0.08, 0.3)  # slow changes of the tilt
WAVES = 5


@dataclass(frozen=True, slots=True, eq=False)
class TipTrajectory:
    """Sampled motion of a hand-held tool in ``base``."""

    times_s: Floats  # (n,) from 0
    tips_base: Floats  # (n, 3) mm
    shafts_base: Floats  # (n, 3) unit directions from the tip to the hand
    rolls_rad: Floats | None = None  # (n,) about the shaft; None: markers face the tracker


class HandMotion:
    """Tip and shaft of one pointer over time, in ``base``; outside its time it stays at the ends.

    The shaft points from the tip to the hand. Its markers are turned about the shaft towards the
    tracker, as an operator does who watches the tracker's light.
    """

    def __init__(
        self,
        pointer: str,
        tip_pointermarker: Vector3,
        tracker_base: Vector3,
        trajectory: TipTrajectory,
        *,
        shaft_pointermarker: Vector3 = UP,
    ) -> None:
        """Lead the tool along a trajectory, interpolated by cubic splines.

        Args:
            pointer: Name of the tool.
            tip_pointermarker: Its true tip (3,).
            tracker_base: Where the tracker stands (3,).
            trajectory: Of tip and shaft; its rolls count from where the markers face the tracker.
            shaft_pointermarker: Direction (3,) of the shaft in the marker frame, as it truly is.
        """
        times_s, rolls_rad = trajectory.times_s, trajectory.rolls_rad
        self.pointer = pointer
        self.duration_s = float(times_s[-1])
        self._tip_pointermarker = tip_pointermarker
        self._tracker_base = tracker_base
        self._tip = CubicSpline(times_s, trajectory.tips_base)
        self._shaft = CubicSpline(times_s, trajectory.shafts_base)
        self._upright = Pose(_turn_onto(shaft_pointermarker, UP), np.zeros(3))
        self._roll = None if rolls_rad is None else CubicSpline(times_s, rolls_rad)

    def tip_base(self, time_s: ArrayLike) -> Floats:
        """Return the true tip (3,) at one time, or (n, 3) at times (n,)."""
        return np.asarray(self._tip(np.clip(time_s, 0.0, self.duration_s)))

    def shaft_base(self, time_s: ArrayLike) -> Floats:
        """Return the unit direction (3,) or (n, 3) from the tip to the hand."""
        shaft = self._shaft(np.clip(time_s, 0.0, self.duration_s))
        return shaft / np.linalg.norm(shaft, axis=-1, keepdims=True)

    def Ts_base_pointermarker(self, times_s: Floats) -> Poses:  # noqa: N802 (frame grammar)
        """Return the true poses of the pointer's marker at times (n,)."""
        tips, shafts = self.tip_base(times_s), self.shaft_base(times_s)
        facing = _across(self._tracker_base - tips, shafts)
        along = np.linalg.norm(facing, axis=1) < 1e-6  # looking along the shaft: any roll will do
        if along.any():
            facing[along] = cross(shafts[along], np.eye(3)[np.abs(shafts[along]).argmin(axis=1)])
        facing = facing / np.linalg.norm(facing, axis=1)[:, None]
        if self._roll is not None:
            rolls = self._roll(np.clip(times_s, 0.0, self.duration_s))[:, None]
            facing = np.cos(rolls) * facing + np.sin(rolls) * cross(shafts, facing)
        if GEOMETRIES[self.pointer].dof == 5:  # z runs along the line to the tip
            axes = (facing, cross(-shafts, facing), -shafts)
        else:  # y runs up the shaft, z towards the tracker
            axes = (cross(shafts, facing), shafts, facing)
        rotations = np.stack(axes, axis=2)
        if GEOMETRIES[self.pointer].dof == 6:
            rotations = rotations @ self._upright.rotation
        return Poses(rotations, tips - rotations @ self._tip_pointermarker)


def _across(vectors: Floats, directions: Floats) -> Floats:
    """Return the parts of vectors (n, 3) across unit directions (n, 3)."""
    return vectors - (vectors * directions).sum(axis=1)[:, None] * directions


def _turn_onto(start: Vector3, end: Vector3) -> Floats:
    """Return the shortest rotation (3, 3) that turns one unit vector onto another."""
    axis = cross(start, end)
    sine, cosine = float(np.linalg.norm(axis)), float(start @ end)
    if sine < 1e-12:
        return np.eye(3)
    return Rotation.from_rotvec(axis * (np.arctan2(sine, cosine) / sine)).as_matrix()


def cross(a: Floats, b: Floats) -> Floats:
    """Return cross products (..., 3), as real numbers for the type checker."""
    return np.asarray(np.cross(a, b), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class BandLimitedNoise:
    """A smooth random function of time with mean 0: a few sines of random frequency and phase."""

    frequencies_hz: Floats  # (d, w)
    phases: Floats  # (d, w)
    amplitude: float  # of each sine

    @classmethod
    def draw(
        cls,
        generator: np.random.Generator,
        band_hz: tuple[float, float],
        rms: float,
        dimensions: int,
    ) -> "BandLimitedNoise":
        """Return a sway in so many dimensions, of RMS ``rms`` in each."""
        shape = (dimensions, WAVES)
        return cls(
            generator.uniform(*band_hz, shape),
            generator.uniform(0.0, 2.0 * np.pi, shape),
            rms * float(np.sqrt(2.0 / WAVES)),
        )

    def at(self, times_s: Floats) -> Floats:
        """Return the values (n, d) at times (n,)."""
        angles = 2.0 * np.pi * self.frequencies_hz * times_s[:, None, None] + self.phases
        return self.amplitude * np.sin(angles).sum(axis=2)


def sample_times_s(duration_s: float) -> Floats:
    """Return the times (n,) at which a motion is laid out, from 0 to ``duration_s``."""
    return np.linspace(0.0, duration_s, int(np.ceil(duration_s * SAMPLES_HZ)) + 1)


def motion_progress(times_s: Floats, generator: np.random.Generator) -> Floats:
    """Return how far along its way a hand is, 0 to 1 (n,): it starts and stops gently.

    In between its speed rises and falls by up to a fifth.
    """
    duration_s = times_s[-1]
    ramp_s = min(0.5, 0.2 * duration_s)
    ends_s = np.minimum(times_s, duration_s - times_s)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.clip(ends_s / ramp_s, 0.0, 1.0))
    frequency_hz, phase = generator.uniform(0.15, 0.4), generator.uniform(0.0, 2.0 * np.pi)
    speed = ramp * (1.0 + 0.2 * np.sin(2.0 * np.pi * frequency_hz * times_s + phase))
    travelled = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))))
    return travelled / travelled[-1]
