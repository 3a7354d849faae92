"""Maps: boundaries detected in the A-scans, mapped and fused; the second pass over gaps."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import Input
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.head_reference import head_input
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.dependencies.step_states import partial_reason
from rona_core.app.runtime.handling import compute_one, compute_several, record
from rona_core.app.steps.acoustics.derivation import KNOWN_LINE, KNOWN_SPEED
from rona_core.app.steps.maps.comparison import compare_with_upload
from rona_core.app.steps.maps.derivation import (
    derive_detection,
    derive_mapping,
    derive_maps,
    derive_second_detection,
)
from rona_core.app.steps.maps.export import EXPORTS
from rona_core.app.steps.maps.further_passes import forget_corrections, with_pass
from rona_core.app.steps.maps.gap_plan import derive_second, recompute_second
from rona_core.app.steps.maps.messages import (
    StartComparison,
    StartGapPlan,
    StartGapScan,
    StartMapping,
)
from rona_core.app.steps.path.painting import PAINTED
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.app.steps.scan.landmarks.gate import failed_reason, verified_first
from rona_core.app.steps.scan.probe_mounting import KNOWN_MOUNTING
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.inputs import DRIVEN, MODEL, PROBE
from rona_core.session.document import Session

SCAN_CAPTURE, SECOND_CAPTURE = capture_input("scan"), capture_input("second")
SURFACE, DETECTION = result_input("surface"), result_input("detection")
MAPS, SECOND = result_input("maps"), result_input("second")

ANY_SECOND = Input(lambda s: s.captures.second, "scan the gaps again (step 9)", optional=True)
ANY_SECOND_DETECTION = Input(
    result_input("second_detection").read, "detect the boundaries", optional=True
)
EDITS = Input(lambda s: s.boundary_edits.without("hand"), "scan (step 8)")
FIRST_EDITS = Input(lambda s: s.boundary_edits.of("first"), "scan (step 8)")
HEAD, HEAD_OF_BOTH = head_input("scan"), head_input("scan", "second")
OUTER_EDITS = Input(lambda s: s.boundary_edits.of("first", "outer"), "scan (step 8)")


def _partial(session: Session) -> str | None:
    cut = partial_reason(REGISTRY.lines["scan"], session)
    return None if cut is None else f"the maps cover only part of the path: {cut}"


def _summary(session: Session) -> str:
    if session.results.detection is None or session.results.maps is None:
        return ""
    found = session.results.detection.value
    return f"inner boundary in {100 * float(found.inner_ok.mean()):.0f} % of A-scans"


STEP = declare.Step(
    "maps",
    activities=(
        declare.Activity(
            StartMapping,
            compute_several(derive_mapping),
            "Mapping the boundaries",
            needs=(SCAN_CAPTURE, SURFACE),
        ),
        declare.Activity(
            StartGapPlan,
            compute_one,
            "Planning the second pass",
            needs=(SCAN_CAPTURE, SURFACE, MAPS),
        ),
        declare.Activity(
            StartGapScan,
            verified_first(
                record(
                    "second", lambda _, session, context: capture_scan(session, context, "second")
                )
            ),
            "Scanning the gaps",
            needs=(SECOND,),
            blocked=failed_reason,
            drives_robot=True,
            records=True,
        ),
        declare.Activity(
            StartComparison,
            compare_with_upload,
            "Comparing the maps with the reference",
            needs=(MAPS,),
        ),
    ),
    captures=(
        declare.Capture(
            "second",
            "scan the gaps again (step 9)",
            (
                parts.robot,
                parts.robot_errors,
                parts.specimen,
                parts.bone_and_probe,
                parts.of_input(SCAN_CAPTURE),  # it looks into the gaps of that scan
                parts.contact,
                parts.CLAMPED_PROBE,
                parts.HEAD,
            ),
            after=SCAN_CAPTURE,
            place=with_pass,
            adds=True,
            stored=forget_corrections,
        ),
    ),
    exports=EXPORTS,
    results=(
        declare.Result(
            "detection",
            StartMapping,
            derive_detection,
            {
                "capture": SCAN_CAPTURE,
                "probe": PROBE,
                "line": KNOWN_LINE,
                "mounting": KNOWN_MOUNTING,
                "head": HEAD,
            },
            "detect the boundaries (step 9)",
        ),
        declare.Result(
            "second",
            StartGapPlan,
            derive_second,
            {
                "detection": DETECTION,
                "correction by hand": FIRST_EDITS,
                "capture": SCAN_CAPTURE,
                "surface": SURFACE,
                "head": HEAD,
                "painted regions": PAINTED,
                **DRIVEN,
            },
            "plan the second pass (step 9)",
            recompute=recompute_second,
        ),
        declare.Result(
            "second_detection",
            StartMapping,
            derive_second_detection,
            {
                "capture": SECOND_CAPTURE,
                "detection": DETECTION,
                "correction by hand": OUTER_EDITS,
                "scan": SCAN_CAPTURE,
                "robot": MODEL,
                "probe": PROBE,
                "line": KNOWN_LINE,
                "mounting": KNOWN_MOUNTING,
                "head": HEAD_OF_BOTH,
            },
            "detect the boundaries",
        ),
        declare.Result(
            "maps",
            StartMapping,
            derive_maps,
            {
                "detection": DETECTION,
                "second": ANY_SECOND,
                "second_detection": ANY_SECOND_DETECTION,
                "correction by hand": EDITS,
                "capture": SCAN_CAPTURE,
                "surface": SURFACE,
                "robot": MODEL,
                "speed": KNOWN_SPEED,
                "mounting": KNOWN_MOUNTING,
                "head": HEAD_OF_BOTH,
            },
            "compute the maps (step 9)",
        ),
    ),
    line=declare.StepLine(
        "Maps",
        _summary,
        StartMapping,
        leaves=lambda session: (MAPS,),
        partial=_partial,
        partial_without=False,
    ),
)
