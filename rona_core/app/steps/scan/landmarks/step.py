"""Landmarks: tracker registration and pointer verified against the robot, before it may scan."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.steps.pointer.inputs import POINTER
from rona_core.app.steps.scan.landmarks.capture import LandmarkCapture, capture_landmarks
from rona_core.app.steps.scan.landmarks.derivation import (
    compare_landmarks,
    override,
)
from rona_core.app.steps.scan.landmarks.gate import judge_landmarks
from rona_core.app.steps.scan.landmarks.inputs import LANDMARKS_CAPTURE
from rona_core.app.steps.scan.landmarks.messages import (
    OverrideLandmarks,
    StartLandmarkCapture,
    VerifyLandmarks,
)
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.inputs import TOOL
from rona_core.app.steps.tool.step import moved_tracker

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
        declare.Result.of(
            "landmarks",
            VerifyLandmarks,
            compare_landmarks,
            "verify on landmarks (step 8)",
            judged=judge_landmarks,
        ),
        declare.Result.of(
            "override", OverrideLandmarks, override, "override the verification (step 8)"
        ),
    ),
)
