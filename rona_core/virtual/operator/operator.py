"""Virtual operator: pivots the pointer and slides its tip over the bone, with tremor."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.settings import DeviceSettings
from rona_core.errors import DeviceError, InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_floats, as_points
from rona_core.geometry.pose import Pose
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.noise import rng
from rona_core.virtual.operator.hand_trajectories import (
    SHAFT_TREMOR_RAD,
    interpolating_curve,
    pivot_axis,
    points_along,
    project_onto_bone,
    raster_curve,
    rotation_in_bush,
    slide_over_region,
    spiral_tilts,
    tangent_axes,
    tilted,
)
from rona_core.virtual.operator.manual_pivot import ManualPivot
from rona_core.virtual.pointer_motion import (
    TILT_HZ,
    TREMOR_HZ,
    TREMOR_MM,
    WANDER_HZ,
    WANDER_MM,
    BandLimitedNoise,
    HandMotion,
    TipTrajectory,
    motion_progress,
    sample_times_s,
)
from rona_core.virtual.scene import VirtualScene

SEAT_SD_MM = 0.04  # per axis: how the tip sits in a divot
LIFTED_MM = 40.0  # between two of them
TIMES_S = (0.1, 60.0)


def touch_landmarks(
    scene: VirtualScene,
    names: tuple[str, ...],
    dwell_s: float,
    travel_s: float,
    generator: np.random.Generator,
) -> TipTrajectory:
    """Return a motion that rests for ``dwell_s`` in each landmark, ``travel_s`` after the last.

    Raises:
        InvalidInputError: no landmark of that name, or a time out of range.
    """
    for time_s in (dwell_s, travel_s):
        if not TIMES_S[0] <= time_s <= TIMES_S[1]:
            raise InvalidInputError(f"dwell_s and travel_s must be 0.1 to 60, not {time_s}")
    unknown = [name for name in names if name not in scene.landmarks_base]
    if unknown or not names:
        raise InvalidInputError(
            f"landmarks must be among {', '.join(scene.landmarks_base)}, not {unknown}"
        )
    places = np.array([scene.landmarks_base[name] for name in names])
    places = places + generator.normal(0.0, SEAT_SD_MM, places.shape)
    times, tips = resting(places, dwell_s, travel_s)
    tremor = BandLimitedNoise.draw(generator, TREMOR_HZ, SHAFT_TREMOR_RAD, 2).at(times)
    sight = scene.T_base_tracker.translation - places.mean(axis=0)
    sight = sight / np.linalg.norm(sight)
    x, y, z = tangent_axes(pivot_axis(sight), sight)
    return TipTrajectory(times, tips, tilted(np.broadcast_to(z, tips.shape), x, y, tremor))


def resting(places: Floats, dwell_s: float, travel_s: float) -> tuple[Floats, Floats]:
    """Return times (m,) and tips (m, 3) of a hand that rests in places (n, 3), lifted between.

    It begins above the first one. Between two it moves with least jerk (Flash 1985).
    """
    each_s = travel_s + dwell_s
    times = sample_times_s(each_s * len(places))
    number = np.minimum((times / each_s).astype(np.int64), len(places) - 1)
    share = np.clip((times - each_s * number) / travel_s, 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    above = places[:1] + (0.0, 0.0, LIFTED_MM)
    starts = np.vstack((above, places[:-1]))[number]
    tips = starts + share[:, None] * (places[number] - starts)
    tips[:, 2] += np.where(number > 0, 4.0 * LIFTED_MM * share * (1.0 - share), 0.0)
    return times, tips


RIM_MM = 12.0  # how far a sweep goes beyond the region
SWEEP_SPACING_MM = 3.0
EDGE_MM = 0.8  # a drawn path is aimed this far inside the region
PICK_REACH_MM = 15.0  # a place further from the bone than this cannot have been meant
MEAN_TILT_RAD = np.deg2rad(8.0)  # away from the tracker, so that the markers are seen better
TILT_RMS_RAD = np.deg2rad(3.0)
MAX_TILT_RAD = np.deg2rad(20.0)
DURATION_S = (1.0, 600.0)
CONE_DEG = (1.0, 60.0)
HALF_TURN_DEG = (1.0, 85.0)
BY_HAND_SPEED = 1.0  # of the clock, whatever the pace of other captures: a person follows it live


class VirtualOperator:
    """Prepares motions of the pointer named in the settings; satisfies ``devices.Operator``."""

    def __init__(self, scene: VirtualScene, clock: CaptureClock | None = None) -> None:
        """Work on this scene; ``clock`` runs in real time during a pivot by hand."""
        self._scene = scene
        self._clock = clock
        self._speeds: tuple[float | None, ...] = ()  # of the clock before it was slowed down
        self._pointer = "pointer6d"
        self._ordinal = 0
        self._motion: HandMotion | ManualPivot | None = None

    def begin(self, scene: VirtualScene, settings: DeviceSettings, ordinal: int) -> None:
        """Lay the pointer aside and get ready for capture number ``ordinal``."""
        self._scene, self._ordinal = scene, ordinal
        self._pointer = settings.pointer
        self._motion = None
        self._at_usual_speed()

    def motion(self) -> HandMotion | ManualPivot | None:
        """Return the motion that has been prepared, or None while the pointer lies aside."""
        return self._motion

    def pivot(self, *, cone_deg: float, duration_s: float) -> float:
        """Hold the tip in the dimple and swing the shaft in a spiral over a cone, out and in.

        Args:
            cone_deg: Half-angle of the cone, 1 to 60 degrees.
            duration_s: 1 to 600 seconds.

        Raises:
            InvalidInputError: a value is out of range.
        """
        _check("cone_deg", cone_deg, CONE_DEG)
        _check("duration_s", duration_s, DURATION_S)
        generator = self._generator()
        times = sample_times_s(duration_s)
        tilt = spiral_tilts(times, np.deg2rad(cone_deg), generator)
        tip = self._scene.dimple_base
        x, y, z = tangent_axes(self._pivot_axis(tip), self._sight(tip))
        shafts = tilted(np.broadcast_to(z, (len(times), 3)), x, y, tilt)
        return self._prepare(TipTrajectory(times, np.broadcast_to(tip, shafts.shape), shafts))

    def pivot_by_hand(self, *, duration_s: float) -> float:
        """Hold the tip in the dimple; the pointer turns about it as :meth:`turn` says.

        Args:
            duration_s: 1 to 600 seconds; :meth:`finish` ends it earlier.

        Raises:
            InvalidInputError: the duration is out of range.
        """
        _check("duration_s", duration_s, DURATION_S)
        tremor = BandLimitedNoise.draw(self._generator(), TREMOR_HZ, SHAFT_TREMOR_RAD, 3)
        tip = self._scene.dimple_base
        times, axis = np.array((0.0, duration_s)), self._pivot_axis(tip)
        rest = self._motion_of(TipTrajectory(times, np.tile(tip, (2, 1)), np.tile(axis, (2, 1))))
        self._motion = ManualPivot(rest, tremor)
        self._at_usual_speed()
        if self._clock is not None:
            self._speeds = (self._clock.speed,)
            self._clock.speed = BY_HAND_SPEED
        return duration_s

    def turn(self, wxyz: ArrayLike) -> None:
        """Turn the pointer about its tip to a rotation relative to the start, axes of ``base``.

        Raises:
            InvalidInputError: no unit quaternion.
            DeviceError: no pivot by hand is under way.
        """
        q = as_floats(wxyz, name="wxyz")
        if q.shape != (4,) or abs(np.linalg.norm(q) - 1.0) > 1e-3:
            raise InvalidInputError("wxyz must be a quaternion (4,) of length 1")
        turn_base = Pose.from_wxyz(q).rotation
        motion = self._motion
        if not isinstance(motion, ManualPivot) or motion.ended:
            raise DeviceError("no pivot by hand is under way: start StartPointerCapture by hand")
        motion.turn(turn_base)

    def finish(self) -> None:
        """End the pivoting by hand; does nothing if there is none."""
        if isinstance(self._motion, ManualPivot):
            self._motion.end()
        self._at_usual_speed()

    def in_hand(self) -> bool:
        """Return whether a pivot by hand is under way."""
        return isinstance(self._motion, ManualPivot) and not self._motion.ended

    def sweep(self, *, duration_s: float) -> float:
        """Slide over the region and 12 mm beyond in lines 3 mm apart.

        Raises:
            InvalidInputError: the duration is not 1 to 600 seconds, or the bone has large holes.
        """
        _, _, radius_mm = self._scene.region_base()
        return self._cover(radius_mm + RIM_MM, 0.0, SWEEP_SPACING_MM, duration_s)

    def draw(self, *, spacing_mm: float, duration_s: float) -> float:
        """Draw a meander with rounded turns that stays inside the region.

        Raises:
            InvalidInputError: a value is out of range, or the bone has large holes.
        """
        _, _, radius_mm = self._scene.region_base()
        return self._cover(radius_mm, EDGE_MM, spacing_mm, duration_s)

    def stroke(self, picks_base: ArrayLike, *, duration_s: float) -> float:
        """Slide through places (n, 3) picked on the bone, in their order.

        Raises:
            InvalidInputError: no places, or one that is not on the specimen, by its number.
        """
        _check("duration_s", duration_s, DURATION_S)
        picks = as_points(picks_base, at_least=1, name="picks_base")
        scene, specimen = self._scene, self._scene.specimen
        T_skull_base = scene.T_base_skull.inv()
        touched = specimen.closest(T_skull_base @ picks)
        away = np.linalg.norm(scene.T_base_skull @ touched - picks, axis=1)
        far = int(np.argmax(np.where(np.isfinite(away), away, np.inf)))
        if not away[far] <= PICK_REACH_MM:
            raise InvalidInputError(
                f"pick {far + 1} of {len(picks)} lies {away[far]:.0f} mm beyond the specimen: "
                "pick places on the bone",
                pick=far + 1,
            )
        generator = self._generator()
        times = sample_times_s(duration_s)
        normals = scene.T_base_skull.rotate(specimen.normal(touched))
        both = interpolating_curve(np.column_stack((scene.T_base_skull @ touched, normals)))
        followed = points_along(both, motion_progress(times, generator))
        points = followed[:, :3]
        outward = followed[:, 3:] / np.linalg.norm(followed[:, 3:], axis=1)[:, None]
        x, y, _ = tangent_axes(outward, self._sight(points))
        shake = self._shake(generator, times)
        points = points + shake[:, :1] * x + shake[:, 1:] * y
        return self._slide(generator, times, points, outward)

    def touch(self, landmarks: tuple[str, ...], *, dwell_s: float, travel_s: float) -> float:
        """Rest with the tip in each landmark in turn; errors as ``touch_landmarks``."""
        generator = self._generator()
        return self._prepare(touch_landmarks(self._scene, landmarks, dwell_s, travel_s, generator))

    def hold(self, tool: str) -> None:
        """Take another tool in the hand than the pointer of the settings, for this capture."""
        self._pointer = tool

    def spin(self, *, half_turn_deg: float, duration_s: float) -> float:
        """Turn the probe to and fro about its own axis, in a bush beside the head.

        Raises:
            InvalidInputError: a value is out of range.
        """
        _check("half_turn_deg", half_turn_deg, HALF_TURN_DEG)
        _check("duration_s", duration_s, DURATION_S)
        axis = self._pivot_axis(self._scene.dimple_base)
        times = sample_times_s(duration_s)
        turned = rotation_in_bush(
            self._scene.dimple_base, axis, np.deg2rad(half_turn_deg), times, self._generator()
        )
        return self._prepare(turned)

    def slide_probe(self, *, spacing_mm: float, duration_s: float) -> float:
        """Slide the face of the probe over the region in lines, pressed on and nearly upright.

        Raises:
            InvalidInputError: a value is out of range, or the bone has large holes.
        """
        _check("duration_s", duration_s, DURATION_S)
        times, generator = sample_times_s(duration_s), self._generator()
        shake = self._shake(generator, times)
        return self._prepare(slide_over_region(self._scene, times, generator, spacing_mm, shake))

    def _cover(
        self, radius_mm: float, edge_mm: float, spacing_mm: float, duration_s: float
    ) -> float:
        """Slide over a disc about the centre of the region, never beyond its rim."""
        _check("duration_s", duration_s, DURATION_S)
        center, normal, _ = self._scene.region_base()
        generator = self._generator()
        times = sample_times_s(duration_s)
        curve = raster_curve(radius_mm - edge_mm, spacing_mm)
        aim = points_along(curve, motion_progress(times, generator)) + self._shake(generator, times)
        distance = np.linalg.norm(aim, axis=1)
        if edge_mm > 0.0:  # approach the rim ever more slowly instead of crossing it
            limit_mm, soft_mm = radius_mm - 0.05, edge_mm
            beyond = np.maximum(distance - (limit_mm - soft_mm), 0.0)
            held = np.minimum(distance, limit_mm - soft_mm) + soft_mm * np.tanh(beyond / soft_mm)
            aim = aim * (held / np.maximum(distance, 1e-9))[:, None]
        x, y, z = tangent_axes(normal, self._sight(center))
        points = center + aim[:, :1] * x + aim[:, 1:] * y
        return self._slide(generator, times, points, np.broadcast_to(z, points.shape))

    def _slide(
        self, generator: np.random.Generator, times: Floats, points: Floats, outward: Floats
    ) -> float:
        """Bring points (n, 3) onto the bone along ``-outward`` and tilt the pointer over it."""
        head = self._scene.head_shift_base(self._ordinal, times)  # the hand follows it
        tips = project_onto_bone(self._scene, times, points, outward) + head
        x, y, _ = tangent_axes(outward, self._sight(points))
        tilt = BandLimitedNoise.draw(generator, TILT_HZ, TILT_RMS_RAD, 2).at(times)
        tilt = tilt - (MEAN_TILT_RAD, 0.0)  # x points to the tracker
        size = np.linalg.norm(tilt, axis=1)[:, None]
        tilt *= np.minimum(size, MAX_TILT_RAD) / np.maximum(size, 1e-9)
        return self._prepare(TipTrajectory(times, tips, tilted(outward, x, y, tilt)))

    def _at_usual_speed(self) -> None:
        speeds, self._speeds = self._speeds, ()
        if self._clock is not None and speeds:
            self._clock.speed = speeds[0]

    def _prepare(self, trajectory: TipTrajectory) -> float:
        self._motion = self._motion_of(trajectory)
        return self._motion.duration_s

    def _motion_of(self, trajectory: TipTrajectory) -> HandMotion:
        scene = self._scene
        return HandMotion(
            self._pointer,
            scene.tips[self._pointer],
            scene.T_base_tracker.translation,
            trajectory,
            shaft_pointermarker=scene.shafts[self._pointer],
        )

    def _shake(self, generator: np.random.Generator, times: Floats) -> Floats:
        tremor = BandLimitedNoise.draw(generator, TREMOR_HZ, TREMOR_MM, 2).at(times)
        return tremor + BandLimitedNoise.draw(generator, WANDER_HZ, WANDER_MM, 2).at(times)

    def _sight(self, points: Floats) -> Floats:
        """Return unit directions (..., 3) from points to the tracker."""
        sight = self._scene.T_base_tracker.translation - points
        return sight / np.linalg.norm(sight, axis=-1, keepdims=True)

    def _pivot_axis(self, tip: Vector3) -> Vector3:
        return pivot_axis(self._sight(tip))

    def _generator(self) -> np.random.Generator:
        return rng(self._scene.seed, "operator", self._ordinal, 0)


def _check(name: str, value: float, limits: tuple[float, float]) -> None:
    low, high = limits
    if not low <= value <= high:
        raise InvalidInputError(f"{name} must be {low:g} to {high:g}, not {value}")
