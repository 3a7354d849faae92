"""Camera presets, in base and mm."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Vector3
from rona_ui.presentation.static_scene import StaticScene

STEP_PRESETS = {  # step -> preset; the camera moves only where the preset changes
    "setup": "Overview",
    "tool": "Overview",
    "pointer": "Overview",
    "surface": "Region",
    "path": "Region",
    "smoothing": "Region",
    "roll": "Roll",
    "scan": "Scan",
    "maps": "Region",
    "implant": "Bed",
}
UP = np.array([0.0, 0.0, 1.0])
FIRST = ((1700.0, -1250.0, 1150.0), (330.0, 10.0, 330.0))  # before the specimen is known
REGION_EYE = np.array([40.0, -72.0, 0.0])  # from which side the region is looked at
BED_EYE = 0.45 * REGION_EYE  # a bed is looked at from the same side, nearer

ROOM = ("Overview", "Region", "Robot")
# Views of the head as it lies, for a skull whose front and sides are not known
TABLE = ("Top", "Left", "Right")
# Views of a head whose axes are known: along which axis, from which end, and which axis is up in
# the picture. Axes are the columns of ``head_axes_base``: right, front, top.
HEAD = {
    "AP": (1, 1.0, 2),
    "Vertex": (2, 1.0, 1),
    "Lateral L": (0, -1.0, 2),
    "Lateral R": (0, 1.0, 2),
}
OFFSETS = {  # preset -> eye and target, from the region or, at the side, the middle of the head
    "Roll": ((150.0, -225.0, 270.0), (-15.0, 0.0, 15.0)),
    "Scan": ((185.0, -300.0, 300.0), (-35.0, 0.0, 40.0)),
    "Top": ((-1.0, 0.0, 620.0), (0.0, 0.0, 0.0)),
    "Left": ((0.0, 620.0, 130.0), (0.0, 0.0, 0.0)),
    "Right": ((0.0, -620.0, 130.0), (0.0, 0.0, 0.0)),
}
HEAD_DISTANCE_MM = 270.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Camera pose: eye, target and up direction in base."""

    eye_base: Vector3
    target_base: Vector3
    up_base: Vector3


def camera_pose(name: str, static_scene: StaticScene | None) -> CameraPose:
    """Return the camera pose of a preset; of an unknown name that of the overview."""
    if static_scene is None:
        return CameraPose(np.array(FIRST[0]), np.array(FIRST[1]), UP)
    if name in HEAD and static_scene.head_axes_base is not None:
        column, sign, upper = HEAD[name]
        axes = static_scene.head_axes_base
        along = static_scene.skull.vertices @ axes
        middle = axes @ (0.5 * (along.min(axis=0) + along.max(axis=0)))
        return CameraPose(
            middle + sign * HEAD_DISTANCE_MM * axes[:, column], middle, axes[:, upper]
        )
    return CameraPose(*_room(name, static_scene), UP)


def _room(name: str, static_scene: StaticScene) -> tuple[Vector3, Vector3]:
    """Return the places of eye and target for a view in which the robot stands upright."""
    center, normal = static_scene.region_center_base, static_scene.region_normal_base
    head = np.array([center[0], center[1], center[2] - 60.0])
    if name == "Region":
        return center + 82.0 * normal + REGION_EYE, center - 3.0 * normal
    if name == "Bed":
        return center + 50.0 * normal + BED_EYE, center - 3.0 * normal
    if name in OFFSETS:
        start = head if name in ("Left", "Right") else center
        eye, target = OFFSETS[name]
        return start + eye, start + target
    if name == "Robot":
        middle = 0.5 * head + np.array([0.0, 0.0, 330.0])
        return middle + np.array([500.0, -1500.0, 380.0]), middle
    middle = 0.62 * head + np.array([0.0, 0.0, 210.0])
    return middle + np.array([900.0, -1050.0, 560.0]), middle
