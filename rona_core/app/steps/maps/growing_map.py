"""Outer boundary while the robot scans: it grows from the A-scans that have come so far.

It is a view. Nothing of it goes into the session, and the scan does not know whether anybody looks.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.derivation import ROBOT_PROBE
from rona_core.app.steps.scan.derivation import KNOWN_MOUNTING
from rona_core.app.steps.scan.planned_motion import plan_of
from rona_core.devices.live import RecordedSoFar
from rona_core.devices.samples import AScanTrack, JointTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.build_maps import map_frame
from rona_core.mapping.coarse_map import coarse_map
from rona_core.mapping.tilted_passes import standoffs_mm
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_core.ultrasound.detection.single.outer_boundary import detect_outer
from rona_core.ultrasound.probe.probe_model import ProbeSurvey

ROUND_MM = 0.5  # limits of the scale are multiples
RIM_MM = 1.0  # so much lower than the planned path may cells beyond its rows lie
Pass = Literal["first", "second"]


@dataclass(frozen=True, slots=True, eq=False)
class GrowingMap:
    """The outer boundary as far as it has been scanned."""

    ordinal: int  # of the capture
    n_scans: int  # A-scans that it is made of
    n_seen: int  # and of those, that show the outer boundary
    points_base: Floats  # (k, 3) cells of the map; the A-scans' own points before there is one
    heights_mm: Floats  # (k,) above the plane of the planned path
    low_mm: float  # of the colour scale, the same from beginning to end
    high_mm: float


class MapGrower:
    """Grows the map of one scan; each A-scan is looked at once."""

    def __init__(self, session: Session, which: Pass, ordinal: int) -> None:
        """Prepare for the scan ``ordinal`` that carries out the plan of a pass.

        Raises:
            DegenerateGeometryError: nothing is planned, or the path is a line.
        """
        plan = plan_of(session, second=which == "second")
        if plan is None or plan.trajectory is None:
            raise DegenerateGeometryError("there is no planned path to lay a map along")
        devices, motion = session.setup.devices, plan.trajectory
        self._ordinal = ordinal
        self._model, self._probe = robot_model(devices.robot.model), required(ROBOT_PROBE, session)
        self._excitation: Excitation = devices.probe.excitation
        maps = session.results.maps
        # a tilted probe has few clear echoes of the outer boundary; the first pass has mapped it
        self._outer = maps.value.outer if maps is not None and which == "second" else None
        mounting = KNOWN_MOUNTING.read(session)
        beyond = Pose.from_translation((0.0, 0.0, 0.0 if mounting is None else mounting.offset_mm))
        self._T_flange_probe = self._model.T_flange_probe @ beyond
        inside = (motion.times_s >= motion.scan_start_s) & (motion.times_s <= motion.scan_end_s)
        planned = self._model.forward(motion.qs_rad[inside]) @ self._T_flange_probe
        places_base = planned.translations
        self._T_base_map = map_frame(places_base, planned.rotations[:, :, 2])
        heights = (self._T_base_map.inv() @ places_base)[:, 2]
        self._low_mm = float(np.floor((heights.min() - RIM_MM) / ROUND_MM) * ROUND_MM)
        self._high_mm = float(np.ceil(heights.max() / ROUND_MM) * ROUND_MM)
        self._n_joints = 0  # that had come when it was looked last
        self._points_base: Floats = np.zeros((0, 3))
        self._ok: Bools = np.zeros(0, dtype=np.bool_)

    def grown(self, recorded: RecordedSoFar) -> GrowingMap:
        """Return the map with what has come since the last time.

        Poses are those of the joint angles as they came: a few milliseconds late, and of a head
        that lies still. The maps of step 9 know better.
        """
        self._look_at(recorded)
        seen = self._points_base[self._ok]
        boundary = coarse_map(self._T_base_map, seen)
        points = seen if boundary is None else boundary.points_base()
        return GrowingMap(
            ordinal=self._ordinal,
            n_scans=len(self._ok),
            n_seen=len(seen),
            points_base=readonly(points),
            heights_mm=readonly((self._T_base_map.inv() @ points)[:, 2]),
            low_mm=self._low_mm,
            high_mm=self._high_mm,
        )

    def _look_at(self, recorded: RecordedSoFar) -> None:
        """Find the outer boundary in the A-scans that are new, and whose joint angles have come."""
        angles = recorded.joints[max(self._n_joints - 1, 0) :]
        last_s = angles[-1].time_s if angles else -np.inf
        new = [scan for scan in recorded.scans[len(self._ok) :] if scan.time_s <= last_s]
        if not new:
            return
        self._n_joints = len(recorded.joints)
        track, joints = AScanTrack.from_scans(new), JointTrack.from_samples(angles)
        found = detect_outer(ProbeSurvey(track, self._probe, self._excitation))
        faces = self._model.forward(joints.at(track.times_s)) @ self._T_flange_probe
        below_mm = found.standoff_mm if self._outer is None else standoffs_mm(self._outer, faces)
        points = faces.translations + below_mm[:, None] * faces.rotations[:, :, 2]
        self._points_base = np.vstack((self._points_base, points))
        self._ok = np.concatenate((self._ok, found.ok))
