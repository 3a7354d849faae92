"""Camera presets, in base and mm."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.robot.kinematics.catalog import robot_model
from rona_ui.presentation.static_scene import StaticScene

STEP_PRESETS = {  # step -> preset; the camera moves only where the preset changes
    "setup": "Head",
    "tool": "Overview",
    "pointer": "Overview",
    "surface": "Region",
    "path": "Region",
    "smoothing": "Region",
    "roll": "Probe",
    "scan": "Probe",
    "maps": "Region",
    "implant": "Region",
}
POINTER_MM = 300.0  # about the tip of a pointer that is pivoted by hand: its handles
FOV_RAD = np.deg2rad(45.0)  # of the height of the canvas
NARROWEST = 0.8  # width of a canvas over its height, where the window does not say
UP = np.array([0.0, 0.0, 1.0])
FIRST = ((-1500.0, -1500.0, 1000.0), (700.0, 200.0, 400.0))  # before the specimen is known
SURGEON = np.array([40.0, -72.0, 0.0])  # from which side of the table the region is looked at

ROOM = ("Overview", "Region", "Oblique", "Robot")
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
SIDES = {  # where the eye is, from the middle of the region or of the head
    "Top": (-0.01, 0.0, 1.0),
    "Left": (0.0, 1.0, 0.2),
    "Right": (0.0, -1.0, 0.2),
}
# of the height of the canvas that the region fills: as large as can be, beside the probe over it,
# and with all of the head
REGION_SHARES = {"Region": 0.6, "Oblique": 0.6, "Probe": 0.4, "Head": 0.25}
HEAD_SHARE = 0.72  # and that a head fills
OBLIQUE_RAD, PROBE_RAD = np.deg2rad(40.0), np.deg2rad(44.0)  # from the normal of the region
OVERVIEW_RAD = np.deg2rad((225.0, 17.0))  # azimuth and height of the eye: over the robot's shoulder
FILLED = 0.95  # of the canvas, by all that the overview is to show
BAR_MM = 330.0  # half the length of the tracker
ARM_MM = 130.0  # about the axes of the robot


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Camera pose: eye, target and up direction in base."""

    eye_base: Vector3
    target_base: Vector3
    up_base: Vector3


def camera_pose(
    name: str, static_scene: StaticScene | None, aspect: float = NARROWEST
) -> CameraPose:
    """Return the camera pose of a preset; of an unknown name that of the overview.

    Args:
        name: Of the preset.
        static_scene: What it looks at.
        aspect: Width of the canvas over its height.
    """
    if static_scene is None:
        return CameraPose(np.array(FIRST[0]), np.array(FIRST[1]), UP)
    skull, axes = static_scene.skull.vertices, static_scene.head_axes_base
    if name in HEAD and axes is not None:
        column, sign, upper = HEAD[name]
        return _of_head(skull, sign * axes[:, column], axes[:, upper], aspect)
    if name in SIDES:
        return _of_head(skull, np.array(SIDES[name]), UP, aspect)
    if name in REGION_SHARES:
        return _of_region(name, static_scene)
    if name == "Robot":
        return _around(_robot(static_scene), np.deg2rad((285.0, 15.0)), aspect)
    return _around(
        np.concatenate((skull, _robot(static_scene), _tracker(static_scene))), OVERVIEW_RAD, aspect
    )


def about_pointer(tip_base: Vector3, aspect: float = NARROWEST) -> CameraPose:
    """Return the camera pose that shows the handles at the tip (3,) of a pointer in base."""
    box = POINTER_MM * np.concatenate((np.eye(3), -np.eye(3)))
    return _around(tip_base + box, OVERVIEW_RAD, aspect)


def distance_mm(size_mm: float, share: float) -> float:
    """Return from where something of a size fills a share of the height of the canvas."""
    return 0.5 * size_mm / (share * float(np.tan(0.5 * FOV_RAD)))


def _of_head(skull: Floats, towards: Vector3, up: Vector3, aspect: float) -> CameraPose:
    """Look at the middle of the head from a side of it."""
    towards = towards / np.linalg.norm(towards)
    middle = 0.5 * (skull.min(axis=0) + skull.max(axis=0))
    size = float(2.0 * np.linalg.norm(skull - middle, axis=1).max())
    return CameraPose(
        middle + distance_mm(size / min(aspect, 1.0), HEAD_SHARE) * towards, middle, up
    )


def _of_region(name: str, static_scene: StaticScene) -> CameraPose:
    """Look at the region: straight onto it, or from the surgeon's side of the table.

    Seen straight, the top of the head is up in the picture, of an unknown head the far side of
    the table.
    """
    center, normal = static_scene.region_center_base, static_scene.region_normal_base
    away = distance_mm(2.0 * static_scene.region_radius_mm, REGION_SHARES[name])
    if name == "Region":
        axes = static_scene.head_axes_base
        candidates = [-SURGEON, UP] if axes is None else [axes[:, 2], axes[:, 1]]
        up = next((c for c in candidates if abs(normal @ c) < 0.9 * np.linalg.norm(c)), UP)
        up = up - (up @ normal) * normal
        return CameraPose(center + away * normal, center, up / np.linalg.norm(up))
    aside = SURGEON - (SURGEON @ normal) * normal
    aside /= np.linalg.norm(aside)
    lean = OBLIQUE_RAD if name == "Oblique" else PROBE_RAD
    return CameraPose(center + away * (np.cos(lean) * normal + np.sin(lean) * aside), center, UP)


def _robot(static_scene: StaticScene) -> Floats:
    """Return places (n, 3) that the robot reaches about when it stands at home."""
    joints = robot_model(static_scene.robot or "rx90").joint_poses(static_scene.home_rad)
    axes = np.array([pose.translation for pose in joints])
    return np.concatenate([axes + ARM_MM * step for step in (*np.eye(3), *-np.eye(3))])


def _tracker(static_scene: StaticScene) -> Floats:
    """Return the two ends (2, 3) of the tracker."""
    return static_scene.T_base_tracker @ np.array([[-BAR_MM, 0.0, 0.0], [BAR_MM, 0.0, 0.0]])


def _around(points: Floats, angles_rad: Floats, aspect: float) -> CameraPose:
    """Look from an azimuth and a height, from as near as all points (n, 3) are seen.

    A point is seen where it lies no farther aside than ``slope`` times how far it is ahead: for
    both sides of the canvas that bounds how far ahead the eye may be, and says where between.
    """
    azimuth, height = angles_rad
    back = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), 0.0])
    back[2] = np.sin(height)
    right = np.cross(UP, back)
    right /= np.linalg.norm(right)
    upper = np.cross(back, right)
    slope = FILLED * float(np.tan(0.5 * FOV_RAD))
    ahead = -points @ back
    places: list[float] = []
    nearest: list[float] = []
    for axis, steep in ((right, aspect * slope), (upper, slope)):
        high, low = (points @ axis - steep * ahead).max(), (-points @ axis - steep * ahead).max()
        places.append(0.5 * float(high - low))
        nearest.append(-0.5 * float(high + low) / steep)
    eye = places[0] * right + places[1] * upper - min(nearest) * back
    target = eye - back * float(ahead.mean() - min(nearest))
    return CameraPose(eye, target, UP)
