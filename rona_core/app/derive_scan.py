"""Compute plan, boundaries and maps: what takes longer, and runs in another process."""

from dataclasses import dataclass, replace

from rona_core.app.messages import StartMapping, StartRollSearch
from rona_core.app.needs import need
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build import build_maps
from rona_core.robot.model import robot_model
from rona_core.robot.plan import RobotPlan
from rona_core.robot.scan_plan import PlanSettings, choose_roll, plan_scan
from rona_core.robot.timing import ScanSettings
from rona_core.session.document import Session
from rona_core.ultrasound.detect import Detection, detect
from rona_core.ultrasound.probe import probe_model


def derive_roll(
    session: Session,
    message: StartRollSearch,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RobotPlan:
    """Judge every roll, and plan, time and verify the scan with the chosen one."""
    smooth = need(session.results.smoothing, "smooth the path").value
    return plan_scan(
        smooth.path,
        robot_model(session.setup.devices.robot.model),
        plan_settings(session, message),
        progress=progress,
        cancel=cancel,
    )


def plan_settings(session: Session, message: StartRollSearch) -> PlanSettings:
    """Return how to search and drive, from what was asked for and the robot's settings."""
    return PlanSettings(
        n_rolls=message.n_rolls,
        roll_from_deg=message.roll_from_deg,
        roll_to_deg=message.roll_to_deg,
        choice=message.choice,
        scan=ScanSettings(scan_speed_mm_per_s=session.setup.devices.robot.scan_speed_mm_per_s),
    )


def derive_chosen_roll(session: Session, plan: RobotPlan, index: int) -> RobotPlan:
    """Plan, time and verify the scan with another roll of a search.

    Raises:
        NotReachableError: the path cannot be followed with this roll; it says why.
    """
    model = robot_model(session.setup.devices.robot.model)
    return choose_roll(plan, index, model, plan_settings(session, StartRollSearch()))


def derive_detection(
    session: Session,
    message: StartMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Detection:
    """Find both boundaries in every A-scan, with those around it as witnesses."""
    capture = need(session.captures.scan, "scan")
    probe = session.setup.devices.probe
    return detect(
        capture.scans,
        probe_model(probe.name),
        probe.excitation,
        method=message.method,
        sound_speed_mm_per_us=message.sound_speed_mm_per_us,
        positions_mm=probe_poses(session).translations,
        progress=progress,
        cancel=cancel,
    )


def probe_poses(session: Session) -> Poses:
    """Return the pose of the probe in ``base`` at each A-scan, from the robot's joint angles."""
    capture = need(session.captures.scan, "scan")
    model = robot_model(session.setup.devices.robot.model)
    return model.forward(capture.joints.at(capture.scans.times_s)) @ model.T_flange_probe


def derive_maps(
    session: Session,
    message: StartMapping,
    detection: Detection,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Maps:
    """Map both boundaries and fuse the outer one with the pointer cloud."""
    cloud = need(session.results.surface, "sample the surface").value
    return build_maps(
        detection,
        probe_poses(session),
        cloud.points_base,
        cell_mm=message.cell_mm,
        progress=progress,
        cancel=cancel,
    )


@dataclass(frozen=True, slots=True)
class Mapped:
    """Both results of step 9."""

    detection: Detection
    maps: Maps


def derive_mapping(
    session: Session,
    message: StartMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Mapped:
    """Detect the boundaries, then map them."""
    found = derive_detection(session, message, progress=lambda p: progress(0.7 * p), cancel=cancel)
    maps = derive_maps(
        session, message, found, progress=lambda p: progress(0.7 + 0.3 * p), cancel=cancel
    )
    return Mapped(found, maps)


def lean(session: Session) -> Session:
    """Return the session without what no computation needs, to send it to another process."""
    return replace(session, archive=(), log=())
