"""Effect of the tracker's fixed error on a calibrated pointer, and what the pivot shows."""

from dataclasses import replace

import numpy as np

from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.pivot.maximum_likelihood import (
    PivotMotion,
    field_of_pivot,
    tip_sensitivity,
)
from rona_core.calibration.tracking_error import LearnedField, TrackerErrorField
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import readonly
from rona_core.session.captures import PointerCapture
from rona_core.session.memo import remember


def with_tracker_field(
    made: PointerCalibration, capture: PointerCapture, stated: TrackerErrorField
) -> PointerCalibration:
    """Return the calibration with what the tracker does the same every time in its sigma."""
    motion = pivot_motion(made, capture)
    moved_by = tip_sensitivity(motion)
    by_tracker = learned_field(made, capture, stated).propagate(
        moved_by.tip, moved_by.points_tracker
    )
    total = made.tip_covariance_pointermarker + by_tracker
    return replace(
        made,
        tip_covariance_pointermarker=readonly((total + total.T) / 2.0),
        random_covariance=made.tip_covariance_pointermarker,
        tip_sigma_mm=float(np.sqrt(np.trace(total))),
    )


@remember(4)
def learned_field(
    made: PointerCalibration, capture: PointerCapture, stated: TrackerErrorField
) -> LearnedField:
    """Return the field of the tracker with the lengths that the pivot makes likely."""
    return field_of_pivot(pivot_motion(made, capture), LearnedField(stated))


def pivot_motion(made: PointerCalibration, capture: PointerCapture) -> PivotMotion:
    """Return the poses of a pivot that count, and what was found of it."""
    return PivotMotion(
        capture.marker.Ts_tracker_marker.select(made.used),
        GEOMETRIES[made.pointer].positions_marker,
        made.dof,
        made.tip_pointermarker,
        made.pivot_tracker,
    )
