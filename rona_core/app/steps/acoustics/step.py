"""Acoustics: delay line, speed of sound, and what other probes would do."""

from rona_core.app.declarations.declarations import Activity, Capture, Command, Result, Step
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.acoustics.captures import record_block, record_thickness, sweep_probes
from rona_core.app.steps.acoustics.derivation import derive_line, derive_speed
from rona_core.app.steps.acoustics.handlers import (
    add_reference_point,
    calibrate_delay_line,
    place_references,
    remove_reference_point,
)
from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateDelayLine,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartCaliperMeasurements,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.setup.capture_parts import input_part, robot_part, specimen_part
from rona_core.app.steps.setup.inputs import BLOCK_PROBE, MODEL

BLOCK, REFERENCES = capture_input("block"), capture_input("references")
SCAN_CAPTURE, DETECTION = capture_input("scan"), result_input("detection")

STEP = Step(
    "acoustics",
    commands=(
        Command(AddReferencePoint, add_reference_point),
        Command(RemoveReferencePoint, remove_reference_point),
        Command(CalibrateSoundSpeed, compute_result, needs=(REFERENCES, DETECTION)),
        Command(CalibrateDelayLine, calibrate_delay_line, needs=(BLOCK,)),
    ),
    activities=(
        Activity(
            StartCaliperMeasurements,
            record_thickness,
            "Measuring with a caliper",
            needs=(SCAN_CAPTURE, DETECTION),
            uses_devices=True,
            records=True,
            shown_in="maps",
        ),
        Activity(
            StartDelayLineCapture,
            record_block,
            "Recording on the reference block",
            uses_devices=True,
            records=True,
            shown_in="setup",
        ),
        Activity(StartProbeSweep, sweep_probes, "Comparing probes", shown_in="setup"),
    ),
    captures=(
        Capture("block", "take A-scans on the block (step 1)", (input_part(BLOCK_PROBE),)),
        Capture(
            "references",
            "measure reference points (step 9)",
            (robot_part, specimen_part),
            place=place_references,
        ),
    ),
    results=(
        Result(
            "line",
            CalibrateDelayLine,
            derive_line,
            {"block": BLOCK, "probe": BLOCK_PROBE},
            "calibrate the delay line (step 1)",
        ),
        Result(
            "speed",
            CalibrateSoundSpeed,
            derive_speed,
            {
                "references": REFERENCES,
                "detection": DETECTION,
                "capture": SCAN_CAPTURE,
                "robot": MODEL,
            },
            "calibrate the speed (step 9)",
        ),
        Result("what_if", StartProbeSweep, None, {}, "compare probes (step 1)"),
    ),
)
