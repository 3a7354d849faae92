"""Postures of the first pass: what "the same robot" does again at a mapped place."""

from typing import TYPE_CHECKING

from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.redundancy.scan_postures import ScanPostures

if TYPE_CHECKING:
    from rona_core.session.document import Session


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
