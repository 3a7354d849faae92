"""The catalogue of robots: models by name, and where their figures come from."""

from collections.abc import Callable, Mapping
from functools import lru_cache

from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.parameter_sources import Figure
from rona_core.robot.kinematics.robot_model import RobotModel


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
    from rona_core.robot.kinematics import rx90
    from rona_core.robot.kinematics import universal_robots as ur

    _builder(name)  # refuses an unknown name
    return rx90.PROVENANCE if name == "rx90" else ur.provenance(name, ur.urdf_path(name))


@lru_cache(maxsize=8)
def _standard(name: str) -> RobotModel:
    return _builder(name)(None)


def _builder(name: str) -> Callable[[Mapping[str, object] | None], RobotModel]:
    from rona_core.robot.kinematics.rx90 import rx90  # the makers of a model need the class above
    from rona_core.robot.kinematics.universal_robots import ur5, ur10

    builders = {"rx90": rx90, "ur5": ur5, "ur10": ur10}
    if name not in builders:
        known = ", ".join(builders)
        raise InvalidInputError(f"there is no robot {name!r}; known robots: {known}")
    return builders[name]
