"""Static scene: skull, region, tracker and robot base, as the devices show them for a set-up."""

from dataclasses import dataclass
from typing import Any

from rona_core.devices.protocols import DrawnHead, Rig
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.codec import digest
from rona_core.session.document import Setup


@dataclass(frozen=True, slots=True, eq=False)
class StaticScene:
    """What the rig shows of itself: fixed while the set-up stays as it is."""

    origin: str  # VIRTUAL, REPLAY or REAL
    skull: Mesh  # in base
    region_center_base: Vector3
    region_normal_base: Vector3
    region_radius_mm: float
    T_base_tracker: Pose
    home_rad: Floats
    head_axes_base: Floats | None = None  # (3, 3) columns right, front, top; None if not known
    T_base_basemarker: Pose | None = None  # None where there is none
    robot: str = ""  # model of the robot; "" without one
    head: DrawnHead | None = None  # in base; None where the skull has a face of its own, or none


def static_scene_key(setup: Setup) -> tuple[Any, ...]:
    """Return what a backdrop depends on."""
    devices = setup.devices
    stands = digest(devices.robot), digest(devices.tracker.place)
    return setup.seed, digest(setup.specimen), digest(setup.region), *stands


def read_static_scene(rig: Rig, setup: Setup) -> StaticScene:
    """Return the backdrop of a rig; takes a moment, as the specimen is meshed."""
    center, normal, radius_mm = rig.display.region()
    return StaticScene(
        origin=rig.origin,
        skull=rig.display.skull_mesh_base(),
        region_center_base=center,
        region_normal_base=normal,
        region_radius_mm=radius_mm,
        T_base_tracker=rig.display.T_base_tracker(),
        T_base_basemarker=rig.display.T_base_basemarker(),
        home_rad=robot_model(setup.devices.robot.model).home_rad,
        head_axes_base=rig.display.head_axes_base(),
        robot=setup.devices.robot.model,
        head=rig.display.drawn_head_base(),
    )
