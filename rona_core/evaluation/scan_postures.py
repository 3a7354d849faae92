"""Postures of the robot during a scan: what "the same robot" does again at a mapped place."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
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
    """Return the postures of all passes of a scan; None before a scan."""
    model = robot_model(session.setup.devices.robot.model)
    passes = (session.captures.scan, *session.captures.second)
    qs = [scan.joints.at(scan.scans.times_s) for scan in passes if scan is not None]
    if not qs or not sum(map(len, qs)):
        return None
    qs_rad = np.concatenate(qs)
    faces = (model.forward(qs_rad) @ model.T_flange_probe).translations
    return ScanPostures(faces, qs_rad)
