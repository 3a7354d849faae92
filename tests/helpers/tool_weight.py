"""What a force sensor shows of the tool that hangs on it, from its load."""

import numpy as np

from rona_core.devices.wrench import ToolLoad
from rona_core.geometry.arrays import Floats
from rona_core.robot.force_control.gravity_compensation import GRAVITY_BASE


def weight_wrench(load: ToolLoad, rotation_base_sensor: Floats) -> Floats:
    """Return the wrench (6,) of the tool alone at an orientation (3, 3), offset included."""
    weight = load.mass_kg * (rotation_base_sensor.T @ GRAVITY_BASE)
    return np.concatenate((weight, np.cross(load.com_sensor_mm, weight))) + load.offset
