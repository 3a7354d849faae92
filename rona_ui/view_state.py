"""What one browser shows: its own view, and the picture of everything that drawing depends on."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rona_core.app.dependencies.step_states import StepState
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.runtime.saving.autosave import CopyState
from rona_core.app.steps.roll.margins_view import Quantity
from rona_core.devices.live import LiveState
from rona_core.devices.protocols import Mesh
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_core.ultrasound.detection.manual_corrections import ScanName
from rona_ui.refusals import Refusal

Point = tuple[float, float, float]
Drawing = Literal["surface", "path", "center", "boundary", "move", "insert", "delete", "keep"]
SliceAcross = Literal["off", "lengthwise", "crosswise"]

# Layers of the scene that can be switched off: name -> what the surgeon reads
LAYERS = {
    "skull": "Skull",
    "robot": "Robot",
    "tracker": "Tracker",
    "pointer": "Pointer",
    "region": "Region",
    "cloud": "Surface points",
    "ghost": "Registered skull",
    "path": "Path",
    "arrows": "Probe axes",
    "warnings": "Path warnings",
    "rolls": "Roll candidates",
    "obstacles": "Obstacles",
    "places": "Base places",
    "scan": "Scan points",
    "outer": "Outer map",
    "inner": "Inner map",
    "fused": "Fused map",
    "second": "Second pass",
    "references": "Reference points",
}

_ROOM = frozenset(("skull", "robot", "tracker", "pointer", "region", "obstacles"))
# What a step needs to be seen; the rest would be in the way
NEEDED: dict[str, frozenset[str]] = {
    "setup": _ROOM,
    "tool": _ROOM,
    "pointer": _ROOM,
    "surface": frozenset(("skull", "pointer", "region", "cloud", "ghost")),
    "path": frozenset(("skull", "pointer", "region", "path")),
    "smoothing": frozenset(("skull", "path", "arrows", "warnings")),
    "roll": frozenset(("skull", "robot", "path", "rolls", "obstacles", "places")),
    "scan": frozenset(("skull", "robot", "path", "scan", "obstacles")),
    "maps": frozenset(
        ("skull", "region", "pointer", "outer", "inner", "fused", "second", "references")
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """A bound that somebody is dragging; it ends when there is another smoothed path."""

    tolerance_mm: float
    smoothing: Any  # the result that was there when it began
    refused: int  # how many messages had been refused


@dataclass(frozen=True, slots=True)
class ViewState:
    """How one browser looks at the session; never saved, never undone."""

    step: str = "setup"
    everything: bool = False  # show also what the step does not need
    hidden: frozenset[str] = frozenset({"outer", "fused", "obstacles"})
    shown_roll: int | None = None  # index of the roll in the graphs; None follows the plan
    place: float | None = None  # 0 to 1 along the path, where that roll is looked at; None: where
    # it fails first, or the middle
    margin: Quantity = "room"  # what the path is coloured by in step 7
    cursor: float | None = None  # 0 to 1 along the planned motion; None shows the robot live
    playing: bool = False
    speed: float = 4.0  # of the replay, as a multiple of real time
    drawing: Drawing | None = None  # what a click on the skull adds to
    picks: tuple[Point, ...] = ()  # in base, mm
    grabbed: int | None = None  # number of the point of the smoothed path that is being moved
    ghost: Point | None = None  # where it is held, in base, mm
    center: Point | None = None  # of the pattern that is to be made
    boundary: tuple[Point, ...] = ()  # of the same
    preview: Preview | None = None
    quantity: Literal["thickness", "height", "sigma"] = "thickness"
    cut: bool = True  # the drawn skull is open over the region once it has been mapped
    slice_across: SliceAcross = "off"  # plane that the drawn skull is cut with, in every step
    slice_mm: float = 0.0  # from the centre of the region to that plane
    slice_maps: bool = False  # the maps are cut too
    force_across: Literal["path", "time"] = "path"  # what the force is drawn over
    by_hand: bool = False  # the scan by hand is looked at, where there are both
    hand_cursor: float = 0.0  # 0 to 1 along the scan by hand
    joint: int = 0  # joint in the graph, 0 for all
    second: bool = False  # replay, A-scans and image are those of the second pass
    hand: tuple[int, float] | None = None  # A-scan and time (µs) that somebody holds a boundary at

    def shows(self, layer: str) -> bool:
        """Return whether a layer of the scene is to be seen."""
        return layer not in self.hidden and (self.everything or layer in NEEDED[self.step])


@dataclass(frozen=True, slots=True, eq=False)
class Backdrop:
    """What the rig shows of itself: fixed while the set-up stays as it is."""

    origin: str  # VIRTUAL, REPLAY or REAL
    skull: Mesh  # in base
    region_center_base: Vector3
    region_normal_base: Vector3
    region_radius_mm: float
    T_base_tracker: Pose
    home_rad: Floats
    head_axes_base: Floats | None = None  # (3, 3) columns right, front, top; None if not known
    T_base_basemarker: Pose | None = None  # None where there is none
    robot: str = ""  # model of the robot; "" where nobody said


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One moment: session, view and live values, all of them immutable."""

    session: Session
    view: ViewState
    steps: tuple[StepState, ...]
    live: LiveState
    job: JobStatus | None = None
    backdrop: Backdrop | None = None
    T_base_pointermarker: Pose | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    saved: bool = False
    copy: CopyState = "none"  # of what is not saved
    can_undo: bool = False
    can_redo: bool = False
    files: tuple[Path, ...] = ()
    changes: bool = False  # something would be lost if the session were closed as it is
    recovered: bool = False  # after a crash, and not saved since
    opened: tuple[tuple[str, str], ...] = ()  # id and name of the open sessions, oldest first
    turning: bool = False  # the pointer is pivoted by hand
    refused: int = 0  # grows when a message was refused, so that fields show the truth again
    refusals: tuple[Refusal, ...] = ()  # what was refused in this session, oldest first

    @property
    def scan(self) -> ScanName:
        """Return whose A-scans are looked at; by hand also where there are no others."""
        captures, view = self.session.captures, self.view
        if captures.sono_scan is not None and (view.by_hand or captures.scan is None):
            return "hand"
        return "second" if view.second else "first"

    @property
    def scan_cursor(self) -> float | None:
        """Return where in the scan that is looked at the cursor is, 0 to 1; None without one."""
        return self.view.hand_cursor if self.scan == "hand" else self.view.cursor

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
        scans = ("StartScan", "StartGapScan", "StartHandheldScan")
        return self.busy and self.job is not None and self.job.activity in scans

    @property
    def busy(self) -> bool:
        """Whether a job is under way."""
        return self.job is not None and not self.job.finished

    def step(self, name: str) -> StepState:
        """Return the state of a step by its name."""
        return next(step for step in self.steps if step.name == name)
