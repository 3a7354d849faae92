"""Landmarks: tracker registration and pointer verified against the robot, before it may scan."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import (
    USABLE,
    ActivityContext,
    Judgement,
    Message,
    Perform,
    Remedy,
)
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import result_input, stale_reason
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import compute_result, handle, record
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.scan.landmarks.capture import (
    LANDMARKS_CAPTURE,
    LandmarkCapture,
    capture_landmarks,
)
from rona_core.app.steps.scan.landmarks.derivation import compare_landmarks, override
from rona_core.app.steps.scan.landmarks.messages import (
    OverrideLandmarks,
    StartLandmarkCapture,
    VerifyLandmarks,
)
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.app.steps.tool.step import moved_tracker
from rona_core.calibration.landmark_check import LandmarkCheck
from rona_core.devices.protocols import Progress
from rona_core.errors import CancelledError, StepBlockedError
from rona_core.session.document import Session

LANDMARKS = result_input("landmarks", optional=True)  # missing or stale: verified before a scan
SHARE = 0.1  # of the progress of a scan that is verified first
REMEDY = "verify again, register again (steps 2 and 3), or override it with a reason"


@dataclass(frozen=True, slots=True)
class Verification:
    """Whether the robot may follow a path, and why."""

    state: Literal["passed", "failed", "overridden", "stale", "missing"]
    sentence: str
    check: LandmarkCheck | None = None  # the newest, stale or not


def verification(session: Session) -> Verification:
    """Return how the verification on landmarks stands."""
    held = session.results.get("landmarks")
    check: LandmarkCheck | None = None if held is None else held.value
    override = session.results.get("override")
    if override is not None and stale_reason("override", session) is None:
        return Verification("overridden", f"Overridden: {override.value.reason}", check)
    if check is None:
        return Verification("missing", "Not verified on landmarks yet.")
    reason = stale_reason("landmarks", session)
    if reason is not None:
        return Verification("stale", f"To be verified again: {reason}.", check)
    if check.verdict == "fail":
        return Verification("failed", f"{'; '.join(check.reasons)}.", check)
    if check.contradiction:
        words = f"Each landmark is within its limit, but {check.contradiction}."
        return Verification("passed", words, check)
    return Verification("passed", "Tracker, pointer and robot agree on the landmarks.", check)


def judge_landmarks(check: LandmarkCheck, session: Session) -> Judgement:
    """Return whether the robot may follow a path after this verification."""
    found = verification(session)
    remedy = Remedy(REMEDY, StartToolCapture())
    if found.state == "failed":
        words = f"the verification on landmarks failed: {found.sentence.rstrip('.')}; {REMEDY}"
        return Judgement("bad", words, remedy)
    if found.state == "overridden" or check.contradiction:
        return Judgement("weak", found.sentence.rstrip("."), remedy)
    return USABLE


def verified_first(perform: Perform) -> Perform:
    """Return what verifies on landmarks, where that was not done, before it does ``perform``."""

    def both(activity: Message, session: Session, context: ActivityContext) -> Iterator[Message]:
        shown = context.progress

        def part(start: float, end: float) -> Progress:
            return lambda share: shown(start + (end - start) * share)

        if verification(session).state in ("missing", "stale"):
            first = replace(context, progress=part(0.0, SHARE))
            taken = capture_landmarks(StartLandmarkCapture(), session, first)
            stored = StoreCapture("landmarks", taken)
            yield stored
            if taken.partial:
                raise CancelledError("stopped on the landmarks: the robot has not moved")
            session = handle(VerifyLandmarks(), handle(stored, session))
            yield VerifyLandmarks()
            context = replace(context, progress=part(SHARE, 1.0))
        found = judge_part("landmarks", session)
        if found.state == "bad":
            raise StepBlockedError(f"the robot has not moved: {found.reason}")
        yield from perform(activity, session, context)

    return both


STEP = declare.Step(
    "landmarks",
    part_of="scan",
    commands=(
        declare.Command(VerifyLandmarks, compute_result, needs=(LANDMARKS_CAPTURE, TOOL, POINTER)),
        declare.Command(OverrideLandmarks, compute_result, needs=(TOOL, POINTER)),
    ),
    activities=(
        declare.Activity(
            StartLandmarkCapture,
            record(
                "landmarks",
                capture_landmarks,
                VerifyLandmarks,
            ),
            "Touching the landmarks",
            needs=(TOOL, POINTER),
            makes=("landmarks",),
            blocked=moved_tracker,
        ),
    ),
    captures=(
        declare.Capture(
            "landmarks",
            "verify on landmarks (step 8)",
            (parts.tracker, parts.robot, parts.robot_errors, parts.pointer),
            types=(LandmarkCapture,),
            done="the landmarks were touched",
        ),
    ),
    results=(
        declare.Result.of(
            "landmarks",
            VerifyLandmarks,
            compare_landmarks,
            "verify on landmarks (step 8)",
            judged=judge_landmarks,
            done="the landmarks were compared",
        ),
        declare.Result.of(
            "override",
            OverrideLandmarks,
            override,
            "override the verification (step 8)",
            done="the verification on landmarks was overridden",
        ),
    ),
)
