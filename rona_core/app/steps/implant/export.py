"""Files of a bed for other programs: its milling path, and the body that is milled away."""

from rona_core.app.steps.implant.view import MillingView, milling_view
from rona_core.errors import NotFoundError
from rona_core.planning.milling.path_files import bed_stl, path_csv, path_gcode
from rona_core.session.document import Session


def _csv(view: MillingView) -> bytes:
    return path_csv(view.path, view.feeds_mm_per_s).encode("utf-8")


def _gcode(view: MillingView) -> bytes:
    return path_gcode(view.path, view.feeds_mm_per_s).encode("utf-8")


def _stl(view: MillingView) -> bytes:
    return bed_stl(view.bed, view.placed.T_base_bed)


MAKERS = {"bed_path.csv": _csv, "bed_path.gcode": _gcode, "bed.stl": _stl}
NAMES = tuple(MAKERS)


def export_bed(session: Session, name: str) -> bytes:
    """Return a file of the bed; the path is in ``bed``, the body in ``base``, both in mm.

    Args:
        session: With its bed.
        name: One of ``NAMES``.

    Raises:
        NotFoundError: there is no such file.
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    make = MAKERS.get(name)
    if make is None:
        raise NotFoundError(f"no file {name!r} of a bed: choose one of {', '.join(NAMES)}")
    return make(milling_view(session))
