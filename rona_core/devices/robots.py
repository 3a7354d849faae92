"""The catalogue of robots: an entry each; settings, models, page, REST and terminal read it.

How to add one: ``docs/how-to/add_a_robot.md``.
"""

from dataclasses import dataclass

Vector = tuple[float, float, float]
Joints = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class UniversalArm:
    """What the description (URDF) of an arm of Universal Robots lacks.

    Lengths, ranges and speeds stand in the file. The head is nearer to a shorter arm.
    """

    home_deg: Joints  # tool pointing down, above the work
    acceleration_rad_per_s2: Joints  # assumed, well below what such arms do
    region_base: Vector  # centre of what is scanned, in mm
    pivot_base: Vector  # of the tool, clear of the head, in mm


@dataclass(frozen=True, slots=True)
class RobotData:
    """A robot: its title, its repeatability and its family."""

    title: str
    repeatability_mm: float  # as its maker states it
    # what its family does not state; None: ``rona_core.robot.kinematics`` has a module of its name
    universal: UniversalArm | None = None


ROBOTS: dict[str, RobotData] = {
    "rx90": RobotData("Stäubli RX90", 0.02),
    "ur5": RobotData(
        "UR5",
        0.1,
        UniversalArm(
            home_deg=(-10.0, -99.0, 56.0, 43.0, 65.0, -90.0),
            acceleration_rad_per_s2=(8.0, 8.0, 8.0, 12.0, 12.0, 12.0),
            region_base=(480.0, 60.0, 300.0),
            pivot_base=(420.0, 60.0, 480.0),
        ),
    ),
    "ur10": RobotData(
        "UR10",
        0.1,
        UniversalArm(
            home_deg=(-20.0, -117.0, 98.0, 19.0, 55.0, -90.0),
            acceleration_rad_per_s2=(5.0, 5.0, 7.0, 10.0, 10.0, 15.0),
            region_base=(600.0, 60.0, 400.0),
            pivot_base=(540.0, 60.0, 580.0),
        ),
    ),
}
UNIVERSAL: dict[str, UniversalArm] = {
    name: robot.universal for name, robot in ROBOTS.items() if robot.universal is not None
}
