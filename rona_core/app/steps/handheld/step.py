"""Handheld: the tracked probe in the hand, calibrated, scanned and mapped without a robot."""

from dataclasses import replace

from rona_core.app.declarations.declarations import (
    Activity,
    Capture,
    Command,
    Result,
    Step,
)
from rona_core.app.dependencies.base_reference import found_again
from rona_core.app.dependencies.inputs import capture_input, result_input, setup_input
from rona_core.app.runtime.computing import compute_several
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.acoustics.derivation import KNOWN_LINE, KNOWN_SPEED
from rona_core.app.steps.handheld.captures import record_calibration, record_hand_scan
from rona_core.app.steps.handheld.derivation import (
    derive_sono,
    derive_sono_detection,
    derive_sono_mapping,
    derive_sono_maps,
)
from rona_core.app.steps.handheld.messages import (
    CalibrateHandheldProbe,
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.setup.capture_parts import (
    bone_and_hand_probe_part,
    bone_and_probe_part,
    robot_part,
    specimen_part,
    tracker_part,
)
from rona_core.app.steps.setup.inputs import (
    CHOOSE_REFERENCE,
    HAND_PROBE,
)
from rona_core.session.document import Session

PIVOT, SPIN = capture_input("sono_pivot"), capture_input("sono_spin")
SCAN, CALIBRATION = capture_input("sono_scan"), result_input("sono")
ANY_TOOL = result_input("tool", optional=True)
ANY_SURFACE = result_input("surface", optional=True)
EDITS = setup_input(lambda s: s.boundary_edits.of("hand"), "scan by hand (step 9)")
REFERENCE = setup_input(lambda s: found_again(s, (s.captures.sono_scan,)), CHOOSE_REFERENCE)


def _forget_corrections(before: Session, after: Session) -> Session:
    """Return ``after`` without the corrections of boundaries in the scan by hand before."""
    return replace(after, boundary_edits=before.boundary_edits.without("hand"))


STEP = Step(
    "handheld",
    commands=(Command(CalibrateHandheldProbe, compute_result, needs=(PIVOT, SPIN)),),
    activities=(
        Activity(
            StartHandheldCalibration,
            record_calibration,
            "Calibrating the SonoPointer",
            uses_devices=True,
            records=True,
        ),
        Activity(
            StartHandheldScan,
            record_hand_scan,
            "Scanning by hand",
            needs=(CALIBRATION,),
            uses_devices=True,
            records=True,
        ),
        Activity(
            StartHandheldMapping,
            compute_several(derive_sono_mapping),
            "Mapping the scan by hand",
            needs=(SCAN, CALIBRATION),
        ),
    ),
    captures=(
        Capture("sono_pivot", "pivot the SonoPointer (step 9)", (tracker_part,)),
        Capture("sono_spin", "turn the SonoPointer about its axis", (tracker_part,)),
        Capture(
            "sono_scan",
            "scan by hand (step 9)",
            (tracker_part, robot_part, specimen_part, bone_and_hand_probe_part),
            # older files: it depended on the pitch of the probe, too
            earlier_setup=(tracker_part, robot_part, specimen_part, bone_and_probe_part),
            stored=_forget_corrections,
        ),
    ),
    results=(
        Result(
            "sono",
            CalibrateHandheldProbe,
            derive_sono,
            {"pivot": PIVOT, "spin": SPIN},
            "calibrate the SonoPointer (step 9)",
        ),
        Result(
            "sono_detection",
            StartHandheldMapping,
            derive_sono_detection,
            {
                "capture": SCAN,
                "calibration": CALIBRATION,
                "tool": ANY_TOOL,
                "probe": HAND_PROBE,
                "line": KNOWN_LINE,
            },
            "map the scan by hand",
            long=True,
        ),
        Result(
            "sono_maps",
            StartHandheldMapping,
            derive_sono_maps,
            {
                "detection": result_input("sono_detection"),
                "correction by hand": EDITS,
                "calibration": CALIBRATION,
                "capture": SCAN,
                "tool": ANY_TOOL,
                "surface": ANY_SURFACE,
                "reference": REFERENCE,
                "speed": KNOWN_SPEED,
            },
            "map the scan by hand",
            long=True,
        ),
    ),
    part_of="maps",
)
