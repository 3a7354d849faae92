"""Postures of the robot during a scan: what "the same robot" does again at a mapped place."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.other_roll import with_other_roll

if TYPE_CHECKING:
    from rona_core.session.document import Session


@dataclass(frozen=True, slots=True, eq=False)
class ScanPostures:
    """Joint angles (n, 6) at the A-scans, and the places (n, 3) of the probe's face in ``base``."""

    faces_base: Floats
    qs_rad: Floats

    def turned(self, model: RobotModel) -> "ScanPostures | None":
        """Return the postures at the same places with another roll; None where none is reached."""
        found = with_other_roll(model, self.qs_rad)
        return None if found is None else ScanPostures(self.faces_base, readonly(found[1]))

    def at(self, points_base: Floats) -> Floats:
        """Return the joint angles (m, 6) with which the robot came nearest to points (m, 3)."""
        return self.qs_rad[KDTree(self.faces_base).query(points_base)[1]]


def scan_postures(session: "Session") -> ScanPostures | None:
    """Return the postures of the first pass of a scan; None before one.

    The robot comes back to a place as it came there first: a further pass may have had another
    posture, and what that does to the maps is their error.
    """
    model, scan = robot_model(session.setup.devices.robot.model), session.captures.scan
    if scan is None or not len(scan.scans.times_s):
        return None
    qs_rad = scan.joints.at(scan.scans.times_s)
    faces = (model.forward(qs_rad) @ model.T_flange_probe).translations
    return ScanPostures(faces, qs_rad)
