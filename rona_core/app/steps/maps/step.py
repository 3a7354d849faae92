"""Maps: boundaries detected in the A-scans, mapped and fused; the tilted passes."""

from dataclasses import replace

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import partial_reason
from rona_core.app.runtime.handling import compute, record
from rona_core.app.steps.maps.comparison import compare_with_upload
from rona_core.app.steps.maps.derivation import (
    build_maps,
    find_boundaries,
    find_inner_boundary,
    plan_tilts,
    plan_tilts_again,
)
from rona_core.app.steps.maps.export import EXPORTS, VOLUME
from rona_core.app.steps.maps.further_passes import (
    all_scanned,
    forget_corrections,
    judge_maps,
    judge_passes,
    judge_plan,
    with_pass,
)
from rona_core.app.steps.maps.inputs import MAPS, SECOND
from rona_core.app.steps.maps.messages import (
    StartComparison,
    StartMapping,
    StartTiltPlan,
    StartTiltScan,
)
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.app.steps.scan.derivation import SCAN
from rona_core.app.steps.scan.landmarks.step import LANDMARKS, verified_first
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.session.document import Session


def _partial(session: Session) -> str | None:
    cut = partial_reason(REGISTRY.lines["scan"], session)
    return None if cut is None else f"the maps cover only part of the path: {cut}"


def _summary(session: Session) -> str:
    maps = session.results.maps
    if maps is None:
        return ""
    return f"inner boundary in {100 * maps.value.inner_share:.0f} % of the outer map"


STEP = declare.Step(
    "maps",
    activities=(
        declare.Activity(
            StartMapping,
            compute,
            "Mapping the boundaries",
            needs=(SCAN, SURFACE),
        ),
        declare.Activity(
            StartTiltPlan,
            compute,
            "Planning the tilted passes",
            needs=(SCAN, SURFACE, MAPS),
        ),
        declare.Activity(
            StartTiltScan,
            verified_first(
                record(
                    "second", lambda _, session, context: capture_scan(session, context, "second")
                )
            ),
            "Scanning with the probe tilted",
            needs=(SECOND, LANDMARKS),
            drives_robot=True,
            makes=("second",),
            blocked=all_scanned,
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
            "scan with the probe tilted (step 9)",
            (
                parts.robot,
                parts.robot_errors,
                parts.specimen,
                parts.bone_and_probe,
                parts.of_input(SCAN, "capture scan"),  # it goes along the path of that scan
                parts.contact,
                parts.CLAMPED_PROBE,
                parts.HEAD,
            ),
            after=SCAN,
            place=with_pass,
            judged=judge_passes,
            adds=True,
            stored=forget_corrections,
            done="the tilted passes were scanned",
        ),
    ),
    exports=(*EXPORTS, VOLUME),
    results=(
        declare.Result.of(
            "detection",
            StartMapping,
            find_boundaries,
            "detect the boundaries (step 9)",
            settings=("method", "sound_speed_mm_per_us"),
            done="the boundaries were detected",
        ),
        replace(
            declare.Result.of(
                "second",
                StartTiltPlan,
                plan_tilts,
                "plan the tilted passes (step 9)",
                judged=judge_plan,
                done="the tilted passes were planned",
            ),
            recompute=plan_tilts_again,
        ),
        replace(
            declare.Result.of(
                "second_detection",
                StartMapping,
                find_inner_boundary,
                "detect the boundaries",
                settings=("method", "sound_speed_mm_per_us"),
                done="the boundaries of the tilted passes were detected",
            ),
            spared=True,
        ),
        declare.Result.of(
            "maps",
            StartMapping,
            build_maps,
            "compute the maps (step 9)",
            judged=judge_maps,
            settings=("sound_speed_mm_per_us", "cell_mm"),
            done="the maps were computed",
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
