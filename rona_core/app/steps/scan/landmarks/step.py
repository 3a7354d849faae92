"""Landmarks: tracker registration and pointer verified against the robot, before it may scan."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import Input
from rona_core.app.dependencies.base_reference import found_again
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.steps.scan.landmarks.capture import LandmarkCapture, capture_landmarks
from rona_core.app.steps.scan.landmarks.derivation import (
    LandmarkOverride,
    derive_landmarks,
    derive_override,
)
from rona_core.app.steps.scan.landmarks.gate import judge_landmarks
from rona_core.app.steps.scan.landmarks.messages import (
    OverrideLandmarks,
    StartLandmarkCapture,
    VerifyLandmarks,
)
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE
from rona_core.app.steps.tool.step import moved_tracker
from rona_core.calibration.landmark_check import LandmarkCheck
from rona_core.session.document import Session

LANDMARKS_CAPTURE = capture_input("landmarks")
TOOL, POINTER = result_input("tool"), result_input("pointer")


def _found_again(session: Session) -> bool:
    held: LandmarkCapture | None = session.captures.get("landmarks")
    return held is None or found_again(session, (held.stroke,))


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
        ),
    ),
    results=(
        declare.Result(
            "landmarks",
            VerifyLandmarks,
            derive_landmarks,
            {
                "capture": LANDMARKS_CAPTURE,
                "tool": TOOL,
                "pointer": POINTER,
                "reference": Input(_found_again, CHOOSE_REFERENCE),
            },
            "verify on landmarks (step 8)",
            judged=judge_landmarks,
            types=(LandmarkCheck,),
        ),
        declare.Result(
            "override",
            OverrideLandmarks,
            derive_override,
            {
                "landmarks": result_input("landmarks", optional=True),
                "tool": TOOL,
                "pointer": POINTER,
            },
            "override the verification (step 8)",
            types=(LandmarkOverride,),
        ),
    ),
)
