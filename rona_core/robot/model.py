"""A robot as the planner sees it: kinematics, limits, rest pose and the tool on its flange."""

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from rona_core.arrays import Floats
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.arm import SphericalWristArm
from rona_core.robot.ik import IkSolutions, inverse
from rona_core.robot.limits import JointLimits


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """The rigid tool: miller and probe in one holder, and the marker plate, as drawn up.

    The probe is clamped in place of the miller, its face where the tip of the miller was. The
    marker plate looks along +z of ``flange``, away from the wrist, and somewhat back up the tool.
    """

    T_flange_tip: Pose
    T_flange_probe: Pose
    T_flange_toolmarker: Pose


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """One robot with its tool. ``dataclasses.replace`` overrides any part of it."""

    name: str
    arm: SphericalWristArm
    limits: JointLimits
    home_rad: Floats  # (6,) where the robot rests, tool down and clear of the head
    tool: Tool

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        return self.arm.forward(qs_rad)

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        return inverse(self.arm, Ts_base_flange)

    def joint_poses(self, q_rad: ArrayLike) -> Poses:
        """Return the seven link frames in ``base``, base and links 1 to 6, for drawing."""
        return self.arm.link_poses(q_rad)

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
        """Pose of the probe face on the flange, z into the bone."""
        return self.tool.T_flange_probe

    @property
    def T_flange_toolmarker(self) -> Pose:  # noqa: N802 (frame grammar)
        """Pose of the marker plate on the flange as drawn up; the true one is calibrated."""
        return self.tool.T_flange_toolmarker


def robot_model(name: str = "rx90") -> RobotModel:
    """Return a robot by name.

    Raises:
        InvalidInputError: no robot of that name.
    """
    builders = _builders()
    if name not in builders:
        known = ", ".join(sorted(builders))
        raise InvalidInputError(f"there is no robot {name!r}; known robots: {known}")
    return builders[name]()


def _builders() -> dict[str, Callable[[], RobotModel]]:
    from rona_core.robot.rx90 import rx90  # the maker of a model needs the class above

    return {"rx90": rx90}
