"""Figures of step 8: detected boundaries of each A-scan against the true bone."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.staleness import made_of
from rona_core.app.steps.acoustics.thickness_uncertainty import at_speed_of_maps
from rona_core.app.steps.scan.head_view import head_report
from rona_core.app.steps.scan.probe_poses import probe_poses_of
from rona_core.devices.wrench import summarize
from rona_core.evaluation.figures import Figures
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.virtual.true_tool_poses import error_keys

if TYPE_CHECKING:
    from rona_core.session.captures import ScanCapture
    from rona_core.session.document import Session
    from rona_core.ultrasound.detection.detect import Detection

WRONG_MM = 1.0  # an inner boundary further off than this is a failure


def detection_figures(
    passes: Sequence["tuple[Detection, tuple[ScanCapture, ...]]"], truth: Truth
) -> Figures:
    """Return the shares of A-scans that are wrong, wrong without a flag, and flagged.

    Those of further passes count like those of the first.

    Args:
        passes: What was detected in the A-scans of captures, one capture after the other; their
            thickness counts as it is, at the speed that it was taken with.
        truth: Of the same session.
    """
    flagged = np.concatenate([detection.flag != 0 for detection, _ in passes])
    if not len(flagged):
        return dict.fromkeys(
            ("detection_failure_fraction", "unflagged_failure_fraction", "flagged_fraction")
        )
    wrong = np.concatenate(
        [
            wrong_inner(
                detection,
                truth.inner_below_mm(Poses.joined([true_probe_poses(s, truth) for s in scans])),
            )
            for detection, scans in passes
        ]
    )
    return {
        "detection_failure_fraction": float(wrong.mean()),
        "unflagged_failure_fraction": float(wrong[~flagged].mean()) if (~flagged).any() else None,
        "flagged_fraction": float(flagged.mean()),
    }


def detected_passes(session: "Session") -> "list[tuple[Detection, tuple[ScanCapture, ...]]]":
    """Return what was found in the A-scans of each pass, its thickness at the speed of the maps.

    Without a pass that was taken again since it was looked through.
    """
    scan, passes = session.captures.scan, list["tuple[Detection, tuple[ScanCapture, ...]]"]()
    first, again = session.results.detection, session.results.second_detection
    if scan is None or first is None or not made_of(first, "capture", scan):
        return passes
    passes.append((first.value, (scan,)))
    further = session.captures.second
    if again is not None and further and made_of(again, "capture", further):
        passes.append((again.value, further))
    poses = [[probe_poses_of(session, one) for one in scans] for _, scans in passes]
    return [
        (
            at_speed_of_maps(session, found, Poses.joined([p for p in stated if p is not None])),
            scans,
        )
        for (found, scans), stated in zip(passes, poses, strict=True)
    ]


def contact_figures(scan: "ScanCapture") -> Figures:
    """Return how well the force kept to its set point, and the largest force of the scan."""
    found = None if scan.forces is None else summarize(scan.forces)
    if found is None:
        return {}
    return {"contact_force_rms_n": found.rms_n, "contact_force_peak_n": found.peak_n}


def head_shift_figures(session: "Session", truth: Truth) -> Figures:
    """Return the error of the mean shift of the head in the scan, as its marker shows it."""
    scan, report = session.captures.scan, head_report(session)
    if scan is None or scan.head is None or report is None:
        return {}
    seen = next(s.shift_mm for s in report.shifts if s.capture == "scan")
    if seen is None:
        return {}
    shifts = truth.scene.head_shift_base(scan.ordinal, scan.head.times_s)
    error = np.array(seen) - (shifts.mean(axis=0) - truth.head_base)
    return {"head_shift_error_mm": float(np.linalg.norm(error))}


def wrong_inner(detection: "Detection", true_mm: Floats) -> Bools:
    """Return which A-scans (n,) place the inner boundary more than 1 mm off along the probe axis.

    Where there is no inner boundary, an A-scan is wrong only if it claims one without a flag.
    """
    measured = detection.standoff_mm + detection.thickness_mm
    missing = ~np.isfinite(true_mm)
    off = np.abs(measured - np.where(missing, 0.0, true_mm)) > WRONG_MM
    return np.where(missing, detection.flag == 0, off)


def true_probe_poses(scan: "ScanCapture", truth: Truth) -> Poses:
    """Return where the probe really was on the head at each A-scan.

    Joint angles arrive somewhat later.
    """
    scene = truth.scene
    model = robot_model(scene.settings.robot.model)
    late_s = scene.settings.robot.latency_ms / 1000.0
    times_s = scan.scans.times_s
    qs_rad = scan.joints.at(times_s + late_s)
    nominal = model.forward(qs_rad) @ model.T_flange_tip
    true = scene.Ts_base_tip_true(nominal, qs_rad, scan.ordinal, error_keys(times_s))
    T_tip_probe = model.T_flange_tip.inv() @ model.T_flange_probe
    probes = true @ (T_tip_probe @ scene.world.clamping)
    moved = scene.head_shift_base(scan.ordinal, times_s) - truth.head_base
    return Poses(probes.rotations, probes.translations - moved) if moved.any() else probes
