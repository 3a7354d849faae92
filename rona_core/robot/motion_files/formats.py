"""Formats of a motion: written by their endings, read by what a file holds."""

from collections.abc import Callable, Mapping

from rona_core.devices.files.ros_bags import is_bag
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.csv_motion import read_csv, write_csv
from rona_core.robot.motion_files.joint_trajectory import read_trajectory, write_json, write_yaml
from rona_core.robot.motion_files.ros_bags import read_bag, write_mcap
from rona_core.robot.motion_files.urscript import read_urscript, write_urscript
from rona_core.robot.verification.joint_motion import JointMotion

URSCRIPT = "script"
WRITERS: Mapping[str, tuple[str, Callable[[CertifiedMotion], bytes]]] = {  # by ending
    "csv": ("joint angles over time", write_csv),
    "json": ("JointTrajectory of ROS as JSON", write_json),
    "yaml": ("JointTrajectory of ROS as YAML", write_yaml),
    URSCRIPT: ("URScript, for arms of Universal Robots", write_urscript),
    "mcap": ("bag of ROS 2 (MCAP), by the extra bags", write_mcap),
}
TABLES, PROGRAMS, MESSAGES = (".csv", ".tsv", ".txt"), (".script", ".urscript"), (".json", ".yaml")


def read_motion(file: NamedFile, model: RobotModel, topic: str | None = None) -> JointMotion:
    """Read a motion of a robot from a table, a JointTrajectory, URScript or a bag.

    Bags are recognised by their first bytes, else the ending of the name says what a file is.

    Args:
        file: Its name and contents.
        model: The robot, for the names of its joints.
        topic: Which of a bag with several.

    Raises:
        InvalidInputError: a format that is not read, or a file that is damaged or ambiguous; it
            says where, and what to do.
    """
    if is_bag(file):
        return read_bag(file, model, topic)
    name = file.name.lower()
    if name.endswith(TABLES):
        return read_csv(file, model)
    try:
        text = file.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInputError(f"{file.name}: expected text, got bytes that are none") from None
    if name.endswith(PROGRAMS):
        return read_urscript(file.name, text)
    if name.endswith((*MESSAGES, ".yml")):
        return read_trajectory(file, text, model)
    endings = ", ".join((*TABLES, *MESSAGES, *PROGRAMS, ".mcap", ".db3", ".bag"))
    raise InvalidInputError(f"{file.name} is no file of a motion that is read: {endings}")
