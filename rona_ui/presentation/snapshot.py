"""Snapshot: session, view and live values of one moment, and what is shown of it.

All that is drawn follows from it: maps, path, joint angles of the drawn robot.
"""

from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np

from rona_core.app.dependencies.judge import StepState
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.milling import MillingView
from rona_core.app.steps.implant.view import (
    milling_duration_s,
    milling_joints_at,
    milling_model,
    milling_stale,
)
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.app.steps.maps.growing_map import GrowingMap
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.view import second_view
from rona_core.app.steps.roll.view import Quantity, joints_of_roll
from rona_core.app.steps.scan.planned_motion import joints_at, motion_stale, motion_times
from rona_core.app.steps.setup.clearance import PairClearance, clearance_violations, stands_clear
from rona_core.app.steps.smoothing.path_view import PathView, path_view, preview_path
from rona_core.devices.live import LiveState
from rona_core.devices.samples import TrackerFrame
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.map_accuracy import MapAccuracy
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_core.robot.kinematics.catalog import milling_robot, robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.session.document import Session
from rona_core.ultrasound.detection.manual_corrections import ScanName
from rona_core.ultrasound.probe.probe_model import probe_model
from rona_ui.presentation.camera import STEP_PRESETS
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import PAINTING, ViewState, VolumeView
from rona_ui.refusals import Refusal


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One moment: session, view and live values, all of them immutable."""

    session: Session
    view: ViewState
    steps: tuple[StepState, ...]
    live: LiveState
    job: JobStatus | None = None
    left_s: float | None = None  # time that the job still takes; None while unknown
    static_scene: StaticScene | None = None
    T_base_pointermarker: Pose | None = None
    frame: TrackerFrame | None = None  # what the tracker says of what is drawn now
    stroke: Floats | None = None  # (k, 3) tip of the pointer in the stroke under way, in base
    growing: GrowingMap | None = None  # outer map of the newest scan, as far as it has come
    figures: dict[str, Any] = field(default_factory=dict)
    judged: Session | None = None  # whose figures they are, None where there are none yet
    computing: bool = False  # those of this session are being computed
    compared: MapComparison | None = None  # the maps beside the reference of the view
    truth: MapComparison | None = None  # the maps beside the true bone, where it is known
    milling: MillingView | None = None  # how the bed of step 10 would be milled; if it is of now
    pivoting_by_hand: bool = False  # the pointer is pivoted by hand
    refused: int = 0  # grows when a message was refused, so that fields show the truth again
    refusals: tuple[Refusal, ...] = ()  # what was refused in this session, oldest first

    @property
    def scan(self) -> ScanName:
        """Return whose A-scans are looked at; by hand also where there are no others."""
        captures, view = self.session.captures, self.view
        if captures.sono_scan is not None and (view.handheld or captures.scan is None):
            return "hand"
        return "second" if view.second else "first"

    @property
    def scan_cursor(self) -> float | None:
        """Return where in the scan that is looked at the cursor is, 0 to 1; None without one."""
        return self.view.handheld_cursor if self.scan == "hand" else self.view.cursor

    @property
    def preview_mm(self) -> float | None:
        """Return the bound that is being dragged in step 6, None if none is."""
        held = self.view.preview
        if held is None or self.view.step != "smoothing" or held.refused != self.refused:
            return None
        return held.tolerance_mm if held.smoothing is self.session.results.smoothing else None

    @property
    def scanning(self) -> bool:
        """Return whether A-scans are taken at this moment, by the robot or by hand."""
        scans = ("StartScan", "StartTiltScan", "StartHandheldScan")
        return self.busy and self.job is not None and self.job.activity in scans

    @property
    def busy(self) -> bool:
        """Whether a job is under way."""
        return self.job is not None and not self.job.finished

    def step(self, name: str) -> StepState:
        """Return the state of a step by its name."""
        return next(step for step in self.steps if step.name == name)


PLAIN = (bool, int, float, str, tuple, frozenset)  # compared by value, all else by identity


def changed(old: Snapshot | None, new: Snapshot, *parts: str) -> bool:
    """Return whether any of these parts, as ``view.step``, differs between two snapshots."""
    if old is None:
        return True
    for part in parts:
        before, after = attrgetter(part)(old), attrgetter(part)(new)
        if before is not after and not (isinstance(after, PLAIN) and before == after):
            return True
    return False


AWAY_RAD = float(np.deg2rad(0.1))  # from home, of any joint
# value at the end of the colour scale
MARGIN_SCALE_MAX: dict[Quantity, float] = {
    "room": 2.0,
    "limits": 45.0,
    "singularity": 3.0,
    "clearance": 50.0,
}


def opening_step(snapshot: Snapshot) -> str:
    """Return the step that a session opens at: its maps, or the last step before that was done."""
    names = [state.name for state in snapshot.steps]
    up_to_maps = snapshot.steps[: names.index("maps") + 1]
    begun = [state.name for state in up_to_maps if state.state in ("done", "partial", "stale")]
    return begun[-1] if begun else names[0]


def opening_view(old: Snapshot | None, new: Snapshot, view: ViewState) -> ViewState:
    """Return the view that a session opens with; a step that was chosen since ``old`` stays."""
    chosen = view.step != (ViewState() if old is None else old.view).step
    return ViewState(step=view.step if chosen else opening_step(new), open_tabs=view.open_tabs)


def shown_path(snapshot: Snapshot) -> PathView | None:
    """Return the shown path: the preview while the tolerance is dragged, else the result."""
    if snapshot.preview_mm is not None:
        return preview_path(snapshot.session, snapshot.preview_mm)
    return path_view(snapshot.session)


def shown_path_key(snapshot: Snapshot) -> tuple[int, int, float | None]:
    """Return a key of the shown path."""
    results = snapshot.session.results
    return id(results.path), id(results.smoothing), snapshot.preview_mm


def shows_margins(snapshot: Snapshot) -> bool:
    """Return whether the path is coloured by margins: those of a motion that still counts."""
    session = snapshot.session
    planned = session.results.roll is not None and motion_stale(session) is None
    return snapshot.view.step == "roll" and planned


def shows_second_path(snapshot: Snapshot) -> bool:
    """Return whether the path of a further pass is shown: selected, or not yet scanned.

    One that is stale is not shown: it lies on maps that are others now.
    """
    view = second_view(snapshot.session)
    if view is None or view.stale is not None:
        return False
    return snapshot.view.second or not view.scanned


def shows_handheld_maps(snapshot: Snapshot) -> bool:
    """Return whether the shown maps are those of the handheld scan."""
    results = snapshot.session.results
    return results.sono_maps is not None and (snapshot.view.handheld or results.maps is None)


def shown_maps(snapshot: Snapshot) -> Maps | None:
    """Return the maps to be seen, in ``base``; None before there are any.

    Maps that are given from the marker on the robot base, because no robot was registered, are
    brought to where that marker is drawn.
    """
    results = snapshot.session.results
    if not shows_handheld_maps(snapshot):
        return None if results.maps is None else results.maps.value
    made = None if results.sono_maps is None else results.sono_maps.value
    if made is None or made.frame == "base":
        return None if made is None else made.maps
    drawn = None if snapshot.static_scene is None else snapshot.static_scene.T_base_basemarker
    return made.maps if drawn is None else made.maps.seen_from(drawn)


def shown_growing_map(snapshot: Snapshot) -> GrowingMap | None:
    """Return the outer map of the scan under way, and of the last one until it is mapped."""
    growing, captures = snapshot.growing, snapshot.session.captures
    if growing is None:
        return None
    if snapshot.scanning:
        return growing if growing.ordinal == snapshot.live.ordinal else None
    taken = [one.ordinal for one in (captures.scan, *captures.second) if one is not None]
    mapped = snapshot.step("maps").state in ("done", "partial")
    return growing if growing.ordinal in taken and not mapped else None


def shown_map_accuracy(snapshot: Snapshot) -> MapAccuracy | None:
    """Return the predicted accuracy of the shown maps; None where it is unknown."""
    return map_accuracy(snapshot.session, hand=shows_handheld_maps(snapshot))


def shown_maps_key(snapshot: Snapshot) -> tuple[Any, ...]:
    """Return a key of the shown maps: equal keys mean the same maps."""
    results = snapshot.session.results
    made = results.sono_maps if shows_handheld_maps(snapshot) else results.maps
    return (id(made), id(snapshot.static_scene))


def shown_volume(snapshot: Snapshot) -> VolumeView | None:
    """Return what is to be drawn of the echo volume; None where nothing is, or the maps changed."""
    volume = snapshot.view.volume
    if volume is None or snapshot.view.step != "maps" or shows_handheld_maps(snapshot):
        return None
    drawn = volume.maps is snapshot.session.results.maps and (volume.slices or volume.surface)
    return volume if drawn else None


def opens_window(view: ViewState) -> bool:
    """Return whether the drawn skull is open over the region; not where things lie on it."""
    if view.step == "implant":
        return view.skull_window and not view.shows("chance") and view.drawing != "implant"
    return view.step == "maps" and view.skull_window and view.drawing != "pair"


def map_sigma(snapshot: Snapshot) -> MapAccuracy | None:
    """Return the map accuracy if the maps are coloured by it (computing it takes a moment)."""
    return shown_map_accuracy(snapshot) if snapshot.view.quantity.startswith("sigma") else None


def shown_comparison(snapshot: Snapshot) -> MapComparison | None:
    """Return the robot's maps beside the reference that was chosen, else beside the truth.

    None where there is none, or where it is one of other maps than those.
    """
    made = snapshot.session.results.maps
    if made is None or shows_handheld_maps(snapshot):
        return None
    found = (snapshot.compared, snapshot.truth)
    return next((one for one in found if one is not None and one.maps is made.value), None)


def map_errors(snapshot: Snapshot) -> MapErrors | None:
    """Return the errors of the shown maps if they are coloured by them."""
    found = shown_comparison(snapshot) if snapshot.view.quantity.startswith("error") else None
    return None if found is None else found.errors


CLEARANCE_STEPS = ("roll", "scan")  # steps that show the clearance of the drawn robot


def shown_joints(snapshot: Snapshot) -> Floats | None:
    """Return joint angles (6,) in rad; None while nothing is known of the robot."""
    live, view, static_scene = snapshot.live.joints, snapshot.view, snapshot.static_scene
    if _robot_changes(snapshot):
        return None
    if snapshot.busy and live is not None:
        return live.q_rad
    replayed = _replayed_joints(snapshot)
    if replayed is not None:
        return replayed
    if shows_roll_preview(snapshot):
        return joints_of_roll(snapshot.session, view.shown_roll, view.place)
    if live is not None:
        return live.q_rad
    return None if static_scene is None else static_scene.home_rad


def _replayed_joints(snapshot: Snapshot) -> Floats | None:
    """Return the joint angles (6,) in rad under the cursor of the replay; None without one."""
    view, session, milling = snapshot.view, snapshot.session, shown_milling(snapshot)
    if milling is not None:
        return milling_joints_at(session, milling)
    if view.step == "implant" or view.cursor is None:
        return None
    fresh = motion_stale(session, second=view.second) is None
    return joints_at(session, view.cursor, second=view.second) if fresh else None


def replay_duration_s(session: Session, view: ViewState) -> float | None:
    """Return how long what is replayed in the step of a view takes; None where nothing is."""
    if view.step == "implant":
        fresh = milling_stale(session) is None
        return milling_duration_s(session) if fresh else None
    times = motion_times(session, second=view.second)
    return None if times is None else times[0]


def shown_milling(snapshot: Snapshot) -> float | None:
    """Return where the replay of the milling is, 0 to 1; None where it is not replayed."""
    view, session = snapshot.view, snapshot.session
    if view.step != "implant" or view.milling_cursor is None or snapshot.milling is None:
        return None
    return None if replay_duration_s(session, view) is None else view.milling_cursor


def shown_robot(snapshot: Snapshot) -> RobotModel:
    """Return the robot that is drawn.

    It holds the spindle while a milling is replayed, and while the burr is registered.
    """
    if shown_milling(snapshot) is not None and snapshot.milling is not None:
        return milling_model(snapshot.session, snapshot.milling)
    name, job = snapshot.session.setup.devices.robot.model, snapshot.job
    if job is not None and not job.finished and job.activity == StartBurrCapture.__name__:
        return milling_robot(name)
    return robot_model(name)


def probe_on_bone(snapshot: Snapshot) -> bool:
    """Return whether the robot at rest is in contact, as after a stop."""
    live = snapshot.live.joints
    if live is None or snapshot.busy or _robot_changes(snapshot):
        return False
    return not stands_clear(snapshot.session, live.q_rad)


def robot_away(snapshot: Snapshot) -> bool:
    """Return whether the robot rests elsewhere than at home, as after a stop."""
    live = snapshot.live.joints
    if live is None or snapshot.busy or _robot_changes(snapshot):
        return False
    home_rad = robot_model(snapshot.session.setup.devices.robot.model).home_rad
    return bool(np.abs(live.q_rad - home_rad).max() > AWAY_RAD)


def _robot_changes(snapshot: Snapshot) -> bool:
    """Return whether another robot has been chosen, and is still being set up."""
    scene, robot = snapshot.static_scene, snapshot.session.setup.devices.robot.model
    return scene is not None and scene.robot not in ("", robot)


def shows_roll_preview(snapshot: Snapshot) -> bool:
    """Return whether the robot is drawn at the selected roll instead of its present pose."""
    view = snapshot.view
    if snapshot.busy or view.cursor is not None or view.step != "roll":
        return False
    if motion_stale(snapshot.session) is not None:
        return False
    return joints_of_roll(snapshot.session, view.shown_roll) is not None


def shown_clearances(snapshot: Snapshot) -> tuple[PairClearance, ...]:
    """Return the clearance violations of the drawn robot, else the nearest pair."""
    q_rad = shown_joints(snapshot)
    if snapshot.view.step not in CLEARANCE_STEPS or q_rad is None:
        return ()
    return clearance_violations(snapshot.session, q_rad)


def shown_preset(snapshot: Snapshot) -> str:
    """Return the preset of what is being done: that of the step, but for picking and pivoting."""
    if snapshot.view.drawing == "region":
        return "Region"
    if snapshot.pivoting_by_hand and snapshot.T_base_pointermarker is not None:
        return "Pointer"
    return STEP_PRESETS[snapshot.view.step]


def footprint(snapshot: Snapshot) -> dict[str, Any] | None:
    """Return its width (mm) and the place in ``base`` (mm) at whose distance it is meant.

    None in modes that mean a point.
    """
    view, scene = snapshot.view, snapshot.static_scene
    if scene is None:
        return None
    if view.drawing == "path":
        radius_mm = probe_model(snapshot.session.setup.devices.probe).aperture_radius_mm
    elif view.drawing in PAINTING:
        radius_mm = view.brush_mm
    else:
        return None
    return {"width_mm": 2.0 * radius_mm, "place_mm": scene.region_center_base.tolist()}
