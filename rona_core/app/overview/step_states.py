"""What can be asked of a session: the state of each step, its results in short, its frames."""

from dataclasses import dataclass
from typing import Any, Literal

from rona_core.app.dependencies.base_reference import carried_remark, placed_reason
from rona_core.app.dependencies.inputs import (
    PATH,
    PATH_CAPTURE,
    POINTER,
    POINTER_CAPTURE,
    ROLL,
    SCAN_CAPTURE,
    SMOOTHING,
    SURFACE,
    SURFACE_CAPTURE,
    TOOL,
    TOOL_CAPTURE,
    Input,
    is_pattern,
    missing,
)
from rona_core.app.dependencies.requirements import blocked_reason, plan_reason
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.messages.registry import (
    SmoothScanPath,
    StartMapping,
    StartPathCapture,
    StartPointerCapture,
    StartRollSearch,
    StartScan,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.app.steps.roll.planned_motion import planned_scans
from rona_core.session.document import STEPS, Session

State = Literal["done", "partial", "ready", "blocked", "stale"]


@dataclass(frozen=True, slots=True)
class StepState:
    """One step of the procedure: what it is, how it stands and why."""

    number: int
    name: str
    title: str
    state: State
    reason: str  # why blocked, stale or partial, or a line about the result
    blocked: str | None = None  # what is to be done before it can be started, again too


TITLES = {
    "setup": "Set-up",
    "tool": "Tool",
    "pointer": "Pointer",
    "surface": "Surface",
    "path": "Path",
    "smoothing": "Smoothing",
    "roll": "Roll",
    "scan": "Scan",
    "maps": "Maps",
}
# step -> (what does it, what that leaves behind)
FLOW: dict[str, tuple[type, tuple[Input, ...]]] = {
    "tool": (StartToolCapture, (TOOL_CAPTURE, TOOL)),
    "pointer": (StartPointerCapture, (POINTER_CAPTURE, POINTER)),
    "surface": (StartSurfaceCapture, (SURFACE_CAPTURE, SURFACE)),
    "path": (StartPathCapture, (PATH_CAPTURE, PATH)),
    "smoothing": (SmoothScanPath, (SMOOTHING,)),
    "roll": (StartRollSearch, (ROLL,)),
    "scan": (StartScan, (SCAN_CAPTURE,)),
    "maps": (StartMapping, ()),
}


def step_states(session: Session) -> tuple[StepState, ...]:
    """Return the state of the nine steps, in order."""
    return tuple(
        StepState(number, name, TITLES[name], *_state(name, session), _blocked(name, session))
        for number, name in enumerate(STEPS, start=1)
    )


def _blocked(name: str, session: Session) -> str | None:
    return None if name == "setup" else blocked_reason(FLOW[name][0], session)


def _state(name: str, session: Session) -> tuple[State, str]:
    if name == "setup":
        return "done", summary("setup", session)
    leaves = FLOW[name][1]
    if name == "path" and is_pattern(session):
        leaves = (PATH,)
    results = ("detection", "maps") if name == "maps" else tuple(i.upstream or "" for i in leaves)
    there = missing(leaves, session) is None
    if name == "maps":
        there = session.results.maps is not None
    if there and name == "tool" and (reason := placed_reason(session)) is not None:
        return "stale", reason
    if there:
        for result in results:
            if (reason := stale_reason(result, session)) is not None:
                return "stale", reason
        if name == "roll" and plan_reason(session) is not None:
            return "ready", summary("roll", session)
    elif (blocked := _blocked(name, session)) is not None:
        return "blocked", blocked
    if (reason := partial_reason(name, session)) is not None and (there or name != "maps"):
        return "partial", reason
    if there:
        return "done", summary(name, session)
    return "ready", partial_reason(name, session) or "ready"


def partial_reason(name: str, session: Session) -> str | None:
    """Return what a step lacks because a recording was stopped early; None where it is whole."""
    if name == "maps":
        cut = partial_reason("scan", session)
        return None if cut is None else f"the maps cover only part of the path: {cut}"
    if name == "path" and is_pattern(session):
        return None
    if name == "scan":
        scan = session.captures.scan
        if scan is None or not scan.partial:
            return None
        came = len(scan.scans)
        planned = max(came, planned_scans(session))
        return f"the scan stopped early, after {came} of {planned} A-scans"
    held: Any = getattr(session.captures, name, None)
    strokes: list[Any] = [*held] if isinstance(held, tuple) else [held]
    if not any(stroke is not None and stroke.partial for stroke in strokes):
        return None
    return "the recording was stopped early: do it again, or go on with what came"


def summary(step: str, session: Session) -> str:
    """Return one line about what a step has produced; empty if nothing yet."""
    results = session.results
    if step == "setup":
        devices = session.setup.devices
        specimen = getattr(session.setup.specimen, "name", "simulated skull")
        probe = devices.probe.name.replace("MHz", " MHz")
        return f"{specimen}, seed {session.setup.seed}, {probe}"
    if step == "tool" and results.tool:
        tool = results.tool.value
        return f"{tool.n_poses} poses, random error {tool.tip_sigma_mm:.2f} mm"
    if step == "pointer" and results.pointer:
        pointer = results.pointer.value
        return f"{pointer.dof}D, {pointer.n_used} poses, random error {pointer.tip_sigma_mm:.2f} mm"
    if step == "surface" and results.surface:
        remark = carried_remark(session, session.captures.surface)
        return f"{len(results.surface.value.points_base)} points{remark}"
    if step == "path" and results.path:
        strokes = () if session.captures.path is None else (session.captures.path,)
        made = "pattern of " if is_pattern(session) else ""
        remark = "" if made else carried_remark(session, strokes)
        return f"{made}{len(results.path.value.points_base)} points{remark}"
    if step == "smoothing" and results.smoothing:
        smooth = results.smoothing.value
        kept, off_mm = smooth.simplified, float(smooth.from_filtered_mm.max())
        by_hand = f", {len(session.path_edits)} by hand" if len(session.path_edits) else ""
        return f"{kept.n_original} to {len(kept.index)} points, K1 {off_mm:.2f} mm{by_hand}"
    if step == "roll" and results.roll:
        return _roll_summary(session)
    if step == "scan" and session.captures.scan:
        return partial_reason("scan", session) or f"{len(session.captures.scan.scans)} A-scans"
    if step == "maps" and results.detection and results.maps:
        found = results.detection.value
        return f"inner boundary in {100 * float(found.inner_ok.mean()):.0f} % of A-scans"
    return ""


def _roll_summary(session: Session) -> str:
    derived = session.results.roll
    if derived is None:
        return ""
    plan = derived.value
    feasible = sum(verdict.feasible for verdict in plan.verdicts)
    counts = f"{feasible} of {len(plan.verdicts)} roll angles feasible"
    if plan.mode == "none" or plan.trajectory is None:
        return f"{counts}: move the robot base or change the path"
    if plan.mode == "variable":
        chosen = f"varying over {plan.roll_variation_deg:.0f}°"
    else:
        chosen = f"{plan.verdicts[plan.chosen].roll_deg:.0f}°"
    if plan_reason(session) is not None:
        return f"{counts}, {chosen}, refused by the verifier"
    return f"{counts}, {chosen}, {plan.trajectory.times_s[-1]:.0f} s"
