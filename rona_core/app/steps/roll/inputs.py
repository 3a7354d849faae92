"""Inputs of motion planning: the path, the robot and what stands around it."""

from dataclasses import dataclass

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.inputs import result_input
from rona_core.app.steps.setup.inputs import BASE, MODEL, OBSTACLES, SCAN_SPEED
from rona_core.devices.settings import RobotSettings
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.session.document import SmoothPath

SMOOTHING: Input[SmoothPath] = result_input("smoothing")


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """What every plan rests on."""

    robot: str  # its model
    scan_speed_mm_per_s: float
    obstacles: Obstacles


DRIVEN: Quantity[Driven] = Quantity(
    Driven, {"robot": MODEL, "scan speed": SCAN_SPEED, "obstacles": OBSTACLES}
)


@inputs()
class RollInputs:
    """What the motion of the scan is planned with."""

    smooth: SmoothPath = given(SMOOTHING, "smoothing")
    driven: Driven = given(DRIVEN)


@inputs()
class PlacementInputs:
    """What places of the robot's base are searched with."""

    smooth: SmoothPath = given(SMOOTHING, "smoothing")
    robot: RobotSettings = given(BASE, "base")
    driven: Driven = given(DRIVEN)
