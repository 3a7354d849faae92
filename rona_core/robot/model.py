"""A robot as the planner sees it: kinematics, limits, rest pose and the tool on its flange."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from numpy.typing import ArrayLike

from rona_core.arrays import Floats
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.arm import Arm
from rona_core.robot.limits import JointLimits
from rona_core.robot.provenance import Figure
from rona_core.robot.solutions import IkSolutions
from rona_core.robot.tool import Tool
from rona_core.robot.workplace import Workplace


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """One robot with its tool. ``dataclasses.replace`` overrides any part of it."""

    name: str
    arm: Arm
    limits: JointLimits
    home_rad: Floats  # (6,) where the robot rests, tool down and clear of the head
    tool: Tool
    workplace: Workplace = field(default_factory=Workplace)
    urdf: str | None = None  # path of the maker's description, where there is one

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        return self.arm.forward(qs_rad)

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        return self.arm.inverse(Ts_base_flange)

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


def robot_model(name: str = "rx90", overrides: Mapping[str, object] | None = None) -> RobotModel:
    """Return a robot by name.

    Args:
        name: One of ``devices.settings.ROBOTS``.
        overrides: Better figures by the keys of ``figures_of(name)``.

    Raises:
        InvalidInputError: no robot of that name, its description is not installed, or an override
            is no good.
    """
    if overrides:
        return _builder(name)(overrides)
    return _standard(name)


def figures_of(name: str) -> tuple[Figure, ...]:
    """Return where every figure of a robot comes from, and how to override it.

    Raises:
        InvalidInputError: no robot of that name, or its description is not installed.
    """
    from rona_core.robot import rx90, ur

    _builder(name)  # refuses an unknown name
    return rx90.PROVENANCE if name == "rx90" else ur.provenance(name, ur.urdf_path(name))


@lru_cache(maxsize=8)
def _standard(name: str) -> RobotModel:
    return _builder(name)(None)


def _builder(name: str) -> Callable[[Mapping[str, object] | None], RobotModel]:
    from rona_core.robot.rx90 import rx90  # the makers of a model need the class above
    from rona_core.robot.ur import ur5, ur10

    builders = {"rx90": rx90, "ur5": ur5, "ur10": ur10}
    if name not in builders:
        known = ", ".join(builders)
        raise InvalidInputError(f"there is no robot {name!r}; known robots: {known}")
    return builders[name]
