"""The devices as small protocols. Virtual, replayed and real ones satisfy the same contract tests.

A capture runs on its own clock: ``Rig.begin`` sets it to 0. A virtual clock jumps when waited on.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, Protocol, TypedDict

from numpy.typing import ArrayLike

from rona_core.devices.samples import AScan, AScanTrack, JointSample, TrackerFrame
from rona_core.devices.settings import DeviceSettings, ProbeSettings
from rona_core.devices.wrench import ForceSensor
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose


class Bench(Protocol):
    """What is measured beside the robot, by hand."""

    def measure_thickness(self, places_base: Floats, axes_base: Floats) -> tuple[Floats, float]:
        """Measure the bone with a caliper at places (n, 3) along inward axes (n, 3).

        Returns:
            Thicknesses (n,) and the standard deviation of the caliper, in mm.

        Raises:
            DeviceError: there is nothing to grip, or no caliper.
        """
        ...

    def record_reference_block(
        self, settings: ProbeSettings, temperature_c: float, n: int
    ) -> AScanTrack:
        """Hold the probe on a flat block of steel and fire ``n`` times, its line this warm."""
        ...

    def taught_landmarks(self) -> tuple[tuple[str, ...], Floats]:
        """Return the landmarks near the head that the robot's tip has touched.

        Returns:
            Their names (n), and the joint angles (n, 6) that the robot's controller kept when its
            tip, led by hand, sat in each.

        Raises:
            DeviceError: the robot reaches too few of them where it stands.
        """
        ...

    def record_gauge_plate(
        self, settings: ProbeSettings, depth_mm: float, n: int
    ) -> tuple[AScanTrack, float]:
        """Press a gauge plate at the robot's holder onto its probe and fire ``n`` times.

        Args:
            settings: Of the probe.
            depth_mm: By which the plate presses the line in, where the probe sits at its place.
            n: A-scans.

        Returns:
            The A-scans, and the standard deviation of the depth in mm that the maker states.
        """
        ...

    def record_on_bone(
        self, settings: ProbeSettings, places_base: Floats, axes_base: Floats, depth_mm: float
    ) -> AScanTrack:
        """Fire a probe by hand once at each place of the bone.

        A collar on the bone holds it along an inward axis and presses its line in.

        Args:
            settings: Of the probe.
            places_base: On the bone (n, 3).
            axes_base: Unit vectors (n, 3) into the bone.
            depth_mm: By which the collar presses the line in.

        Raises:
            DeviceError: there is no bone at a place.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class DrawnHead:
    """A head for the eye: the true calvaria, and beneath it a face that is no person's."""

    calvaria: Mesh  # the part of the outer surface above brow, ear canal and inion
    face: Mesh  # from a template
    shades: Floats  # (n,) 0 to 1: how much light reaches each vertex of the face
    sutures: Floats  # (k, 2, 3) segments on the calvaria


class Display(Protocol):
    """What is drawn for the eye, never an input of an algorithm."""

    def skull_mesh_base(self) -> Mesh:
        """Return the outer surface of the specimen in ``base``."""
        ...

    def drawn_head_base(self) -> DrawnHead | None:
        """Return the head in ``base``; None where the surface of the specimen shows its own."""
        ...

    def pick(self, origin_base: ArrayLike, direction_base: ArrayLike) -> Vector3 | None:
        """Return where a ray of sight meets the drawn skull (3,), or None if it misses."""
        ...

    def point_mesh(self, point_base: ArrayLike) -> Vector3:
        """Return a place of ``base`` (3,) in ``mesh``, in which the region is chosen."""
        ...

    def region(self) -> tuple[Vector3, Vector3, float]:
        """Return centre (3,), outward normal (3,) in ``base`` and radius in mm of the region."""
        ...

    def head_axes_base(self) -> Floats | None:
        """Return right, front and top of the head as unit columns (3, 3) in ``base``.

        None where the source of the skull does not say which way is which.
        """
        ...

    def T_base_tracker(self) -> Pose:  # noqa: N802 (frame grammar)
        """Return where the tracker stands, to draw it and its volume."""
        ...

    def T_base_basemarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the marker on the robot base is, to draw it; None if there is none."""
        ...

    def T_base_pointermarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the pointer is now, to draw it; None while it lies aside."""
        ...


Origin = Literal["VIRTUAL", "REPLAY", "REAL"]
Cancel = Callable[[], bool]  # True once Cancel or Stop was pressed
Progress = Callable[[float], None]  # 0 to 1


def never() -> bool:
    """Return False, never cancelled: the default of ``cancel``."""
    return False


def silent(share: float) -> None:
    """Ignore the progress: the default of ``progress``."""


class Work(TypedDict, total=False):
    """How a long computation reports and is stopped."""

    progress: Progress
    cancel: Cancel


class Clock(Protocol):
    """Time of the capture in seconds."""

    def now(self) -> float:
        """Return the time since the capture began."""
        ...

    def wait_until(self, time_s: float) -> None:
        """Return once ``time_s`` has come; a virtual clock jumps there (paced if shown live)."""
        ...


class Tracker(Protocol):
    """An optical tracking system."""

    def latest(self) -> TrackerFrame:
        """Return the newest frame without waiting for another."""
        ...

    def past(self, since_s: float, rate_hz: float) -> list[TrackerFrame]:
        """Return frames that came since a time of this capture, about ``rate_hz`` a second.

        What a capture records beside them is not held up. The clock does not move.
        """
        ...

    def frames(self) -> Iterator[TrackerFrame]:
        """Yield frames at the tracker's rate, waiting for each; endless, so the caller breaks."""
        ...

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        ...


class Motion(Protocol):
    """A motion under way."""

    def done(self) -> bool:
        """Return whether the motion has ended, by arriving or by being stopped."""
        ...

    def progress(self) -> float:
        """Return the share that is done, 0 to 1."""
        ...


class GuidedMotion(Motion, Protocol):
    """A motion under way that is corrected along the tool axis, step by step."""

    def correct(self, velocity_mm_per_s: float, feed_share: float) -> None:
        """Correct at this speed from now on, and drive at this share of the motion's own speed.

        The robot takes up the correction with its delay, and keeps within the corrections that
        the motion was given for.
        """
        ...

    def reached_s(self) -> float:
        """Return the time of the motion that has been reached."""
        ...

    def travel_mm(self) -> float:
        """Return the correction reached, as the robot reports it."""
        ...


class Robot(Protocol):
    """A robot arm with six joints."""

    def state(self) -> JointSample:
        """Return the joint angles that arrive now; they may have been read somewhat earlier."""
        ...

    def move(self, times_s: ArrayLike, qs_rad: ArrayLike) -> Motion:
        """Start along joint angles (n, 6) at times (n,), counted from now.

        Raises:
            DeviceError: a joint limit would be exceeded, or the motion starts elsewhere.
        """
        ...

    def move_seated(
        self, times_s: ArrayLike, qs_rad: ArrayLike, seated_s: tuple[float, float]
    ) -> Motion:
        """Start a motion as ``move`` does, and yield to a seat that holds the tip meanwhile.

        Args:
            times_s: Times (n,), counted from now.
            qs_rad: Joint angles (n, 6).
            seated_s: From when until when the tip sits in the seat. The arm gives way to it, so
                that its joint angles are not quite those of the motion.

        Raises:
            DeviceError: as for ``move``, or no robot here can yield.
        """
        ...

    def guide(self, times_s: ArrayLike, qs_rad: ArrayLike, travels_mm: ArrayLike) -> GuidedMotion:
        """Start a motion that rests until a correction and a share of speed are commanded.

        Args:
            times_s: Times (n,) of the motion at its full speed, from 0.
            qs_rad: Joint angles (n, m, 6) at each time and correction.
            travels_mm: Corrections (m,) along the tool axis, positive into the surface.

        Raises:
            DeviceError: a joint limit would be exceeded, or the motion starts elsewhere.
        """
        ...

    def place(self, q_rad: ArrayLike) -> None:
        """Stand at these joint angles before a capture begins (a real robot refuses)."""
        ...

    def stop(self) -> None:
        """Stop at once; always allowed, a second call does nothing."""
        ...

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        ...


class Probe(Protocol):
    """An A-mode ultrasound probe held by the robot."""

    def acquire(self) -> AScan:
        """Fire once, now, and return the trace."""
        ...

    def fire(self) -> None:
        """Fire once, now, and keep the trace until it is collected."""
        ...

    def collect(self) -> list[AScan]:
        """Return the traces that were kept since the last call, in their order."""
        ...

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        ...


class Operator(Protocol):
    """The hand that holds the pointer. Each call prepares a motion that starts with the capture.

    All return the duration of the motion in seconds. The pointer meant is the one in the settings.
    """

    def pivot(self, *, cone_deg: float, duration_s: float) -> float:
        """Hold the tip in a dimple and swing the pointer over a cone."""
        ...

    def pivot_by_hand(self, *, duration_s: float) -> float:
        """Hold the tip in a dimple while a person turns the pointer by :meth:`turn`."""
        ...

    def turn(self, wxyz: ArrayLike) -> None:
        """Tell the hand a rotation (4,) relative to the start, along the axes of ``base``.

        Safe from any thread, the last one counts; the hand follows at its own speed.

        Raises:
            DeviceError: no pivot by hand is under way.
        """
        ...

    def finish(self) -> None:
        """End a pivoting by hand before its time; does nothing if there is none."""
        ...

    def in_hand(self) -> bool:
        """Return whether a pivot by hand is under way."""
        ...

    def sweep(self, *, duration_s: float) -> float:
        """Slide the tip over the region to be scanned, and somewhat beyond, in dense strokes."""
        ...

    def draw(self, *, spacing_mm: float, duration_s: float) -> float:
        """Demonstrate a scan path: a meander over the region, lines ``spacing_mm`` apart."""
        ...

    def touch(self, landmarks: tuple[str, ...], *, dwell_s: float, travel_s: float) -> float:
        """Rest with the tip in each landmark for a while, and take so long from each to the next.

        The first is reached after ``travel_s``.
        """
        ...

    def hold(self, tool: str) -> None:
        """Take another tool in the hand than the pointer of the settings, for this capture."""
        ...

    def spin(self, *, half_turn_deg: float, duration_s: float) -> float:
        """Turn the probe to and fro about its own axis, in a bush that leaves it only that."""
        ...

    def slide_probe(self, *, spacing_mm: float, duration_s: float) -> float:
        """Slide the face of the probe over the region, with gel, in lines so far apart."""
        ...

    def stroke(self, picks_base: ArrayLike, *, duration_s: float) -> float:
        """Follow places (n, 3) chosen on the drawn skull, touching each."""
        ...


class Rig(Protocol):
    """All devices of one session."""

    @property
    def origin(self) -> Origin:
        """Whether these devices are virtual, replayed or real."""
        ...

    @property
    def clock(self) -> Clock:
        """Time of the capture."""
        ...

    @property
    def tracker(self) -> Tracker:
        """The optical tracking system."""
        ...

    @property
    def robot(self) -> Robot:
        """The robot."""
        ...

    @property
    def probe(self) -> Probe:
        """The ultrasound probe."""
        ...

    @property
    def force(self) -> ForceSensor:
        """The force sensor between flange and tool."""
        ...

    @property
    def operator(self) -> Operator:
        """The hand that holds the pointer."""
        ...

    @property
    def bench(self) -> Bench:
        """Caliper and block of steel."""
        ...

    @property
    def display(self) -> Display:
        """What is drawn for the eye."""
        ...

    def begin(self, settings: DeviceSettings, ordinal: int) -> None:
        """Configure every device for capture number ``ordinal`` and set the clock to 0."""
        ...

    def close(self) -> None:
        """Release all devices; a second call does nothing."""
        ...
