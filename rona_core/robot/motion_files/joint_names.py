"""Which column of a file belongs to which joint: by the names of the joints, never by their place.

ROS sorts joint states by the alphabet, so that the elbow of a UR arm comes before its shoulder.
"""

import re
from collections.abc import Sequence

from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.pinocchio_model import pinocchio_model
from rona_core.robot.kinematics.robot_model import RobotModel

NUMBERED = re.compile(r"(?:^|[_\W])(?:joint|axis|j|q|a)[_\W]?([1-6])$")


def joint_names(model: RobotModel) -> tuple[str, ...]:
    """Return the names of the six joints, base first, as the description has them."""
    return tuple(list(pinocchio_model(model)[0].names)[1:])


def columns_of_joints(stated: Sequence[str], model: RobotModel, where: str) -> list[int]:
    """Return which of the stated names is each of the six joints.

    A name may have a prefix (``left_shoulder_pan_joint``), or only a number (``joint_3``, ``q3``).

    Raises:
        InvalidInputError: a joint is missing, or stated twice; it names them.
    """
    names = joint_names(model)
    lower = [name.lower() for name in stated]
    own = [name.lower() for name in names]
    numbers = [str(number) for number in range(1, len(names) + 1)]
    stated_numbers = [named[1] if (named := NUMBERED.search(name)) else "" for name in lower]
    for found in (
        [[k for k, other in enumerate(lower) if other == name] for name in own],
        [[k for k, other in enumerate(lower) if other.endswith(name)] for name in own],
        [[k for k, other in enumerate(stated_numbers) if other == n] for n in numbers],
    ):
        if all(len(columns) == 1 for columns in found):
            return [columns[0] for columns in found]
    raise InvalidInputError(
        f"{where}: expected one column for each joint of the {model.name} ({', '.join(names)}, or "
        f"numbered such as joint_1), got {', '.join(stated) or 'no names'}"
    )
