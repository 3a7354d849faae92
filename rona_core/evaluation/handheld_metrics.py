"""Figures of the hand-held probe: calibration, and maps against the true bone."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.evaluation.figures import Figures, rms
from rona_core.evaluation.map_metrics import (
    covered,
    inner_errors_mm,
    outer_errors_mm,
    thickness_errors_mm,
)
from rona_core.evaluation.truth import Truth

if TYPE_CHECKING:
    from rona_core.calibration.handheld.tracked_probe import SonoCalibration
    from rona_core.session.document import SonoMaps


def sono_calibration_figures(calibration: "SonoCalibration", truth: Truth) -> Figures:
    """Return how far face and axis of the probe are from where they really are."""
    true, found = truth.scene.T_sonomarker_probe, calibration.T_sonomarker_probe
    axes = true.rotation[:, 2], found.rotation[:, 2]
    angle = np.arctan2(np.linalg.norm(np.cross(*axes)), axes[0] @ axes[1])
    off = np.linalg.norm(found.translation - true.translation)
    return {"sono_face_error_mm": float(off), "sono_axis_error_deg": float(np.rad2deg(angle))}


def sono_map_figures(result: "SonoMaps", truth: Truth) -> Figures:
    """Return the errors of the maps of a scan by hand, and their coverage.

    Without the robot they are in the frame of the base marker; then its true mounting brings them
    to ``base``, here alone.
    """
    maps = result.maps
    if result.frame == "basemarker":
        maps = maps.seen_from(truth.scene.T_base_basemarker)
    region = truth.region_points()
    return {
        "sono_outer_rms_mm": rms(outer_errors_mm(maps.outer.points_base(), truth, False)),
        "sono_inner_rms_mm": rms(inner_errors_mm(maps.inner.points_base(), truth, False)),
        "sono_thickness_rms_mm": rms(thickness_errors_mm(maps, truth)),
        "sono_coverage_fraction": covered(maps.outer, region),
        "sono_inner_coverage_fraction": covered(maps.inner, region),
    }
