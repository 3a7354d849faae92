"""Figures of step 9: sound speed used for the map against that of the true bone."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.steps.acoustics.thickness_uncertainty import speed_of_maps
from rona_core.evaluation.figures import Figures, rms
from rona_core.evaluation.scan_metrics import WRONG_MM, true_probe_poses
from rona_core.evaluation.truth import Truth
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at
from rona_core.virtual.acoustics.medium import bone_medium, true_bone

if TYPE_CHECKING:
    from rona_core.session.document import Session


def speed_figures(session: "Session", truth: Truth) -> Figures:
    """Return how far the speed of the map is off, and the thickness of A-scans with it.

    Both over the A-scans that are sure of their inner boundary; the error of the thickness is along
    the axis of the probe, and leaves out those that took another echo (1 mm off and more).
    """
    detection, maps, scan = session.results.detection, session.results.maps, session.captures.scan
    if detection is None or maps is None or scan is None or len(scan.scans) != len(detection.value):
        return {}
    ok = np.asarray(detection.value.inner_ok)
    poses = true_probe_poses(scan, Truth(truth.scene))  # on the head at rest
    medium = bone_medium(truth.scene.world)
    true, depth = true_bone(poses, truth.scene, medium)
    nominal = detection.value.sound_speed_mm_per_us
    used = np.full(len(ok), nominal)
    known = speed_of_maps(session)
    if known is not None:
        used = speed_at(known, maps.value.outer_points_base[: len(ok)])[0]
    sure = ok & np.isfinite(true)
    if not sure.any():
        return {"sound_speed_error_percent": None, "scan_thickness_rms_mm": None}
    error = detection.value.thickness_mm * used / nominal - depth
    right = error[sure & (np.abs(error) < WRONG_MM)]
    return {
        "sound_speed_error_percent": 100.0 * float(np.mean(used[sure] / true[sure] - 1.0)),
        "scan_thickness_rms_mm": rms(right),
    }
