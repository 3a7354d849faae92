"""Read what the devices show of themselves, once for each set-up."""

from typing import Any

from rona_core.devices.protocols import Rig
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.codec import digest
from rona_core.session.document import Setup
from rona_ui.view_state import Backdrop


def backdrop_key(setup: Setup) -> tuple[Any, ...]:
    """Return what a backdrop depends on."""
    devices = setup.devices
    stands = digest(devices.robot), digest(devices.tracker.place)
    return setup.seed, digest(setup.specimen), digest(setup.region), *stands


def read_backdrop(rig: Rig, setup: Setup) -> Backdrop:
    """Return the backdrop of a rig; takes a moment, as the specimen is meshed."""
    center, normal, radius_mm = rig.display.region()
    return Backdrop(
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
    )
