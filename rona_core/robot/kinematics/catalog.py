"""The catalogue of robots: models by name, and where their figures come from."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from rona_core.devices.robots import ROBOTS, UNIVERSAL
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics import rx90
from rona_core.robot.kinematics import universal_robots as ur
from rona_core.robot.kinematics.parameter_sources import Figure
from rona_core.robot.kinematics.robot_model import RobotModel, Spindle


def robot_model(name: str = "rx90", overrides: Mapping[str, object] | None = None) -> RobotModel:
    """Return a robot by name.

    Args:
        name: One of ``devices.robots.ROBOTS``.
        overrides: Better figures by the keys of ``figures_of(name)``.

    Raises:
        InvalidInputError: no robot of that name, its description is not installed, or an override
            is no good.
    """
    return _built(name, overrides) if overrides else _standard(name)


@lru_cache(maxsize=8)
def milling_robot(
    name: str = "rx90",
    burr_radius_mm: float = 2.5,
    offset_tip: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> RobotModel:
    """Return a robot by name that holds the spindle, with a burr no larger than this.

    ``offset_tip`` (3,) in mm is where the tip of the burr was registered, off its drawing.

    Raises:
        InvalidInputError: no robot of that name, or a burr of another size than there are.
    """
    model = robot_model(name)
    return model.with_tool(model.tool.with_spindle(Spindle(burr_radius_mm), offset_tip))


ANY_TURN_DEG = (720.0,) * 6  # more than any joint turns


@lru_cache(maxsize=8)
def described_robot(urdf: Path) -> RobotModel:
    """Return the arm of a description (URDF), with the joint limits that the file states.

    A description states no accelerations: those of the arm of the catalogue with the same lengths
    are taken, else of the first one of its family. The tool is the one that RONA draws.

    Raises:
        InvalidInputError: the file cannot be read, or describes an arm of another build.
    """
    turns = {"room_lower_deg": [-turn for turn in ANY_TURN_DEG], "room_upper_deg": ANY_TURN_DEG}
    models = [ur.ur(name, turns, urdf=urdf) for name in UNIVERSAL]
    known = zip(models, UNIVERSAL, strict=True)
    return next((model for model, name in known if model.name == name), models[0])


def figures_of(name: str) -> tuple[Figure, ...]:
    """Return where every figure of a robot comes from, and how to override it.

    Raises:
        InvalidInputError: no robot of that name, or its description is not installed.
    """
    _require_known(name)
    return ur.provenance(name, ur.urdf_path(name)) if name in UNIVERSAL else rx90.PROVENANCE


@lru_cache(maxsize=8)
def _standard(name: str) -> RobotModel:
    return _built(name, None)


def _built(name: str, overrides: Mapping[str, object] | None) -> RobotModel:
    _require_known(name)
    return ur.ur(name, overrides) if name in UNIVERSAL else rx90.rx90(overrides)


def _require_known(name: str) -> None:
    if name not in ROBOTS:
        raise InvalidInputError(f"there is no robot {name!r}; known robots: {', '.join(ROBOTS)}")
