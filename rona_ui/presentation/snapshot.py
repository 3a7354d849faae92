"""Snapshot: session, view and live values of one moment; all that is drawn follows from it."""

from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

from rona_core.app.dependencies.judge import StepState
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.implant.bed_milling import MillingView
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.app.steps.maps.growing_map import GrowingMap
from rona_core.devices.live import LiveState
from rona_core.devices.samples import TrackerFrame
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_core.ultrasound.detection.manual_corrections import ScanName
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState
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
