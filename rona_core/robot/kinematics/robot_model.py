"""A robot as the planner sees it: kinematics, limits, rest pose and the tool on its flange.

The milling tool in the robot's hand: a motor spindle with its burr, clamped in the tool holder.
RONA holds a surgical motor of 30000 rpm (Aesculap microtron EC/GD622) perpendicular to the flange;
its drawing is not published. Every length here is assumed, for the reason beside it, and rather too
thick than too thin. The tip is that of the calibrated tool: a stop in the spindle brings every burr
to the same length.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.limits import require_within
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, as_vector3, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.arm import Arm, IkSolutions, as_posture, wrapped

TURN_RAD = 2.0 * np.pi
NEARLY_ROUND_RAD = np.deg2rad(300.0)  # a joint with this range may pass the far side at +-180
EDGE_RAD = 1e-9  # rounding that is forgiven at a limit


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """Position, speed and acceleration limits of the six joints; every array is (6,)."""

    lower_rad: Floats
    upper_rad: Floats
    speed_rad_per_s: Floats
    acceleration_rad_per_s2: Floats

    def __post_init__(self) -> None:
        for name in ("lower_rad", "upper_rad", "speed_rad_per_s", "acceleration_rad_per_s2"):
            values = as_floats(getattr(self, name), name=name)
            if values.shape != (6,):
                raise InvalidInputError(f"{name} must have shape (6,), not {values.shape}")
            object.__setattr__(self, name, readonly(values))
        if (self.lower_rad >= self.upper_rad).any():
            raise InvalidInputError("each lower joint limit must lie below the upper one")
        if min(self.speed_rad_per_s.min(), self.acceleration_rad_per_s2.min()) <= 0.0:
            raise InvalidInputError("speed and acceleration limits must be positive")

    def clearance_rad(self, qs_rad: ArrayLike) -> Floats:
        """Return the distance (..., 6) to the nearer limit; negative outside."""
        qs = np.asarray(qs_rad, dtype=np.float64)
        return np.minimum(qs - self.lower_rad, self.upper_rad - qs)

    def multi_turn(self) -> Bools:
        """Return which joints (6,) have a range of more than one turn."""
        return self.upper_rad - self.lower_rad > TURN_RAD + EDGE_RAD

    def spinning(self) -> tuple[int, ...]:
        """Return the joints (0 to 5) for which +180 and -180 degrees are one place on a path."""
        return tuple(np.flatnonzero(self.upper_rad - self.lower_rad >= NEARLY_ROUND_RAD).tolist())


def shift_to_fit(angles_rad: Floats, lower_rad: float, upper_rad: float) -> Floats:
    """Return continuous angles (n, b) of one joint, each column shifted by full turns.

    A column that fits between the limits is shifted to where its clearance is largest, any other
    one to where it stays inside for longest from the start.
    """
    middle = (lower_rad + upper_rad) / 2.0
    low, high = angles_rad.min(axis=0), angles_rad.max(axis=0)
    turns = np.round((middle - (low + high) / 2.0) / TURN_RAD)
    shifted = angles_rad + TURN_RAD * turns
    outside = (low + TURN_RAD * turns < lower_rad) | (high + TURN_RAD * turns > upper_rad)
    if outside.any():
        shifted[:, outside] = _longest_inside(angles_rad[:, outside], lower_rad, upper_rad)
    return shifted


def _longest_inside(angles_rad: Floats, lower_rad: float, upper_rad: float) -> Floats:
    """Return curves (n, b), each shifted so that it leaves the limits as late as possible."""
    middle = (lower_rad + upper_rad) / 2.0
    nearest = np.round((middle - angles_rad[0]) / TURN_RAD)
    best, survived = nearest, np.full(angles_rad.shape[1], -1, dtype=np.int64)
    for turns in (nearest, nearest - 1.0, nearest + 1.0):
        candidate = angles_rad + TURN_RAD * turns
        outside = (candidate < lower_rad) | (candidate > upper_rad)
        first = np.where(outside.any(axis=0), outside.argmax(axis=0), len(outside))
        best = np.where(first > survived, turns, best)
        survived = np.maximum(first, survived)
    return angles_rad + TURN_RAD * best


Profile = tuple[tuple[float, float], ...]  # radius and height in mm, in ``tip``

OCTAGON = math.tan(math.pi / 8.0)  # half a side of an octagon about a circle of radius 1
BODY: Profile = (
    (4.0, -30.0),  # nose: a chuck of 6 mm for shanks of 2.35 mm, with its bearing
    (5.0, -45.0),  # slim, so that the surgeon sees the burr
    (10.0, -70.0),  # handpieces are as thick as a pencil grip there
    (13.0, -91.0),  # where the holder clamps, like the probe: its ring is 28 mm thick
    (13.0, -150.0),  # motor: these are 20 to 25 mm thick, and stand out behind the holder
)


@dataclass(frozen=True, slots=True)
class Spindle:
    """Motor, nose, and the burr that stands out of it; turned about z of ``tip``."""

    burr_radius_mm: float = 2.5  # of the largest burr that is used
    shank_radius_mm: float = 1.2  # of the common shank of 2.35 mm; smaller balls have thinner necks
    body: Profile = BODY  # begins at the nose, out of which the burr stands

    def __post_init__(self) -> None:
        require_within("burr_radius_mm", self.burr_radius_mm, 0.25, 6.0)
        require_within("shank_radius_mm", self.shank_radius_mm, 0.1, 3.0)

    @property
    def burr(self) -> Profile:
        """Return the burr, a ball within eight tangents, with its shank up to the nose."""
        radius, (_, nose_mm) = self.burr_radius_mm, self.body[0]
        near, far = radius * (1.0 - OCTAGON), radius * (1.0 + OCTAGON)
        return (
            (radius * OCTAGON, 0.0),
            (radius, -near),
            (radius, -far),
            (self.shank_radius_mm, nose_mm),
        )


Place = tuple[float, float, float]

TOOL_TIP_FLANGE_MM = (120.0, 0.0, 60.0)
MARKER_TILT_RAD = np.deg2rad(20.0)


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """The rigid tool: miller and probe in one holder, and the marker plate, as drawn up.

    The probe is clamped in place of the miller, its face where the tip of the miller was. The
    marker plate looks along +z of ``flange``, away from the wrist, and somewhat back up the tool.
    """

    T_flange_tip: Pose
    T_flange_probe: Pose
    T_flange_toolmarker: Pose
    mass_kg: float = 0.2  # of all that hangs on the force sensor; assumed, a scan weighs it
    mass_sigma_kg: float = 0.015  # standard deviation of that assumption
    spindle: Spindle | None = None  # clamped in place of the probe; None: the probe is
    burr_offset_tip: Place = (0.0, 0.0, 0.0)  # of its tip off the drawing, as it was registered

    def with_spindle(self, spindle: Spindle, offset_tip: Place = (0.0, 0.0, 0.0)) -> "Tool":
        """Return the tool with the miller in place of the probe, its tip off the drawing's.

        Args:
            spindle: With its largest burr.
            offset_tip: Of the registered tip (3,) in mm, in ``tip`` as it is drawn.
        """
        T_flange_tip = self.T_flange_tip @ Pose.from_translation(offset_tip)
        T_tip_probe = Pose.identity()  # the burr ends where the tip of the tool does
        return replace(
            self,
            T_flange_tip=T_flange_tip,
            T_flange_probe=T_flange_tip @ T_tip_probe,
            spindle=spindle,
            burr_offset_tip=offset_tip,
        )


@dataclass(frozen=True, slots=True)
class WorkArea:
    """Places in ``base`` that suit the reach of an arm; the base stands at its default place."""

    region_base: tuple[float, float, float] = (600.0, 60.0, 400.0)  # centre of what is scanned
    pivot_base: tuple[float, float, float] = (560.0, -50.0, 560.0)  # clear of the head
    facing_base: tuple[float, float, float] = (0.866, 0.5, 0.0)  # of the marker plate meanwhile


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """One robot with its tool. ``dataclasses.replace`` overrides any part of it."""

    name: str
    arm: Arm
    limits: JointLimits
    home_rad: Floats  # (6,) where the robot rests, tool down and clear of the head
    tool: Tool
    # parts two joints or more apart that the build or the joint limits keep from each other
    held_apart: tuple[tuple[str, str], ...] = ()
    work_area: WorkArea = field(default_factory=WorkArea)
    urdf: str | None = None  # path of the maker's description, where there is one

    def with_tool(self, tool: Tool) -> "RobotModel":
        """Return the robot with another tool in its hand."""
        return replace(self, tool=tool)

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        return self.arm.forward(qs_rad)

    def up_flange(self, q_rad: Floats) -> Floats:
        """Return z of ``base`` (3,) in ``flange`` for one posture (6,)."""
        return self.arm.up_flange(q_rad)

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        return self.arm.inverse(Ts_base_flange)

    def follow(self, Ts_base_flange: Poses, q_start_rad: Floats, largest_step_rad: float) -> Floats:
        """Return joint angles (m, 6) along n poses from a posture (6,), each near the one before.

        They end (m < n) where a joint limit would be passed, or a joint turn by more than the
        largest step: the arm would go over to another branch.
        """
        return self.follow_each(Ts_base_flange, q_start_rad[None], largest_step_rad)[0]

    def follow_each(
        self, Ts_base_flange: Poses, qs_start_rad: Floats, largest_step_rad: float
    ) -> list[Floats]:
        """Return what ``follow`` does from k postures (k, 6), each along n poses of its own (k n,).

        A tenth of the time, where each way is short.
        """
        k = len(qs_start_rad)
        solutions = self.inverse(Ts_base_flange)
        qs = solutions.qs_rad.reshape(k, -1, *solutions.qs_rad.shape[1:])
        out_of_reach = ~solutions.valid.reshape(qs.shape[:3])
        found = np.zeros((k, 1 + qs.shape[1], qs.shape[3]))
        found[:, 0], lengths = qs_start_rad, np.zeros(k, dtype=np.int64)
        on = np.arange(k)
        for place in range(qs.shape[1]):
            steps = wrapped(qs[on, place] - found[on, place, None])
            sizes = np.abs(steps).max(axis=2)
            sizes[out_of_reach[on, place]] = np.inf
            nearest = sizes.argmin(axis=1)
            rows = np.arange(len(on))
            q = found[on, place] + steps[rows, nearest]
            good = sizes[rows, nearest] <= largest_step_rad
            good &= self.limits.clearance_rad(q).min(axis=1) >= 0.0
            on = on[good]
            found[on, place + 1], lengths[on] = q[good], place + 1
            if not len(on):
                break
        return [way[1 : 1 + length] for way, length in zip(found, lengths.tolist(), strict=True)]

    def joint_poses(self, q_rad: ArrayLike) -> Poses:
        """Return the seven link frames in ``base``, base and links 1 to 6, for drawing."""
        rotations, positions = self.arm.link_frames(as_posture(q_rad)[None])
        return Poses.unchecked(rotations[0], positions[0])

    @property
    def lower_rad(self) -> Floats:
        """Lower joint limits (6,)."""
        return self.limits.lower_rad

    @property
    def upper_rad(self) -> Floats:
        """Upper joint limits (6,)."""
        return self.limits.upper_rad

    @property
    def speed_rad_per_s(self) -> Floats:
        """Largest joint speeds (6,)."""
        return self.limits.speed_rad_per_s

    @property
    def acceleration_rad_per_s2(self) -> Floats:
        """Largest joint accelerations (6,)."""
        return self.limits.acceleration_rad_per_s2

    @property
    def T_flange_tip(self) -> Pose:  # noqa: N802 (frame grammar)
        """Pose of the tool tip on the flange, z along the tool axis."""
        return self.tool.T_flange_tip

    @property
    def T_flange_probe(self) -> Pose:  # noqa: N802 (frame grammar)
        """Pose on the flange of the face of the probe or the tip of the burr; z into the bone."""
        return self.tool.T_flange_probe

    @property
    def T_flange_toolmarker(self) -> Pose:  # noqa: N802 (frame grammar)
        """Pose of the marker plate on the flange as drawn up; the true one is calibrated."""
        return self.tool.T_flange_toolmarker


def perpendicular_tool(tip_flange: ArrayLike = TOOL_TIP_FLANGE_MM) -> Tool:
    """Return the tool: its axis along +x of ``flange``, the marker plate looking away from the arm.

    The plate stands above the tool opposite the tip and is tilted back, so that a tracker above
    the working place sees it.
    """
    rotation_tip = (0.0, np.pi / 2.0, 0.0)
    T_flange_tip = Pose.from_rotvec(rotation_tip, as_vector3(tip_flange, name="tip_flange"))
    c, s = np.cos(MARKER_TILT_RAD), np.sin(MARKER_TILT_RAD)
    facing_tip, up_tip = np.array((-c, 0.0, -s)), np.array((s, 0.0, -c))
    rotation = np.column_stack((np.cross(up_tip, facing_tip), up_tip, facing_tip))
    T_tip_probe = Pose.identity()  # the face of the probe sits where the tip of the miller was
    tip_toolmarker = GEOMETRIES["toolmarker"].nominal_tip_marker
    T_tip_toolmarker = Pose(rotation, -rotation @ tip_toolmarker)
    return Tool(
        T_flange_tip=T_flange_tip,
        T_flange_probe=T_flange_tip @ T_tip_probe,
        T_flange_toolmarker=T_flange_tip @ T_tip_toolmarker,
    )
