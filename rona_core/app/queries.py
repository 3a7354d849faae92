"""What can be asked of a session: the state of each step, its results in short, its frames."""

from dataclasses import dataclass
from typing import Literal

from rona_core.app.inputs import (
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
from rona_core.app.staleness import stale_reason
from rona_core.session.document import STEPS, Session
from rona_core.session.reference import carried_remark, placed_reason

State = Literal["done", "ready", "blocked", "stale"]


@dataclass(frozen=True, slots=True)
class StepState:
    """One step of the procedure: what it is, how it stands and why."""

    number: int
    name: str
    title: str
    state: State
    reason: str  # why blocked or stale, or a line about the result


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
# step -> (what it needs, what it leaves behind)
FLOW: dict[str, tuple[tuple[Input, ...], tuple[Input, ...]]] = {
    "tool": ((), (TOOL_CAPTURE, TOOL)),
    "pointer": ((), (POINTER_CAPTURE, POINTER)),
    "surface": ((TOOL, POINTER), (SURFACE_CAPTURE, SURFACE)),
    "path": ((TOOL, POINTER), (PATH_CAPTURE, PATH)),
    "smoothing": ((PATH, SURFACE), (SMOOTHING,)),
    "roll": ((SMOOTHING,), (ROLL,)),
    "scan": ((ROLL,), (SCAN_CAPTURE,)),
    "maps": ((SCAN_CAPTURE, SURFACE), ()),
}


def step_states(session: Session) -> tuple[StepState, ...]:
    """Return the state of the nine steps, in order."""
    return tuple(
        StepState(number, name, TITLES[name], *_state(name, session))
        for number, name in enumerate(STEPS, start=1)
    )


def _state(name: str, session: Session) -> tuple[State, str]:
    if name == "setup":
        return "done", summary("setup", session)
    needs, leaves = FLOW[name]
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
        if name == "roll" and session.results.roll and session.results.roll.value.mode == "none":
            return "ready", summary("roll", session)
        if name == "roll" and _is_refused(session):
            return "ready", summary("roll", session)
        return "done", summary(name, session)
    wanted = missing(needs, session)
    if wanted is not None:
        return "blocked", f"first {wanted}"
    if name in ("surface", "path") and (reason := placed_reason(session)) is not None:
        return "blocked", reason
    if name == "scan" and session.results.roll and session.results.roll.value.mode == "none":
        return "blocked", "first find a roll that the robot can traverse (step 7)"
    if name == "scan" and _is_refused(session):
        return "blocked", "the verifier refuses the motion (step 7): choose another roll"
    return "ready", "ready"


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
        kept = results.smoothing.value.simplified
        by_hand = f", {len(session.path_edits)} by hand" if len(session.path_edits) else ""
        return f"{kept.n_original} to {len(kept.index)} points, K1 {kept.k1_mm:.2f} mm{by_hand}"
    if step == "roll" and results.roll:
        return _roll_summary(session)
    if step == "scan" and session.captures.scan:
        scan = session.captures.scan
        return f"{len(scan.scans)} A-scans" + (", stopped early" if scan.partial else "")
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
    counts = f"{feasible} of {len(plan.verdicts)} rolls work"
    if plan.mode == "none" or plan.trajectory is None:
        return f"{counts}: move the robot base or change the path"
    if plan.mode == "variable":
        chosen = f"varying over {plan.roll_variation_deg:.0f}°"
    else:
        chosen = f"{plan.verdicts[plan.chosen].roll_deg:.0f}°"
    if _is_refused(session):
        return f"{counts}, {chosen}, refused by the verifier"
    return f"{counts}, {chosen}, {plan.trajectory.times_s[-1]:.0f} s"


def _is_refused(session: Session) -> bool:
    """Return whether a motion is planned that the verifier has refused."""
    derived = session.results.roll
    certificate = None if derived is None else derived.value.certificate
    return certificate is not None and not certificate.certified
