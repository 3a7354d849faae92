"""Calibration of the pointer from its pivoting."""

from rona_core.app.steps.pointer.inputs import PointerInputs
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.pointer.pivot_report import calibrate_imported
from rona_core.app.steps.pointer.tracker_field import with_tracker_field
from rona_core.app.steps.tool.derivation import excluded_mask
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.devices.trackers import GEOMETRIES
from rona_core.session.captures import is_imported


def calibrate(known: PointerInputs, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: they tell too little.
    """
    capture = known.capture
    geometry = GEOMETRIES[capture.pointer]
    exclude = excluded_mask(message.exclude, len(capture.marker.times_s))
    if is_imported(capture):
        made = calibrate_imported(capture, method=message.method, exclude=exclude)
    else:
        made = calibrate_pointer(
            capture.marker.Ts_tracker_marker,
            pointer=capture.pointer,
            dof=geometry.dof,
            method=message.method,
            positions_pointermarker=geometry.positions_marker,
            exclude=exclude,
        )
    return with_tracker_field(made, capture, known.field)
