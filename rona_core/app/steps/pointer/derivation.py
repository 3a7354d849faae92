"""Pointer calibration from its pivoting."""

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.tool.derivation import excluded_mask
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.session.document import Session


def derive_pointer(session: Session, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: they tell too little.
    """
    capture = require_result(session.captures.pointer, "record the pivoting of the pointer")
    geometry = GEOMETRIES[capture.pointer]
    return calibrate_pointer(
        capture.marker.Ts_tracker_marker,
        pointer=capture.pointer,
        dof=geometry.dof,
        method=message.method,
        positions_pointermarker=geometry.positions_marker,
        exclude=excluded_mask(message.exclude, len(capture.marker.times_s)),
    )
