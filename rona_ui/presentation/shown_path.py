"""Path that is shown: computed or previewed, its colour scales, and the path of the second pass."""

import numpy as np

from rona_core.app.steps.maps.view import SecondView
from rona_core.app.steps.roll.margins_view import Quantity
from rona_core.app.steps.smoothing.path_view import PathView, path_view, preview_path
from rona_ui.presentation.snapshot import Snapshot

# value at the end of the colour scale
MARGIN_SCALE_MAX: dict[Quantity, float] = {
    "room": 2.0,
    "limits": 45.0,
    "singularity": 3.0,
    "clearance": 50.0,
}


def shown_path(snapshot: Snapshot) -> PathView | None:
    """Return the shown path: the preview while the tolerance is dragged, else the result."""
    if snapshot.preview_mm is not None:
        return preview_path(snapshot.session, snapshot.preview_mm)
    return path_view(snapshot.session)


def shown_path_key(snapshot: Snapshot) -> tuple[int, int, float | None]:
    """Return a key of the shown path."""
    results = snapshot.session.results
    return id(results.path), id(results.smoothing), snapshot.preview_mm


def shows_margins(snapshot: Snapshot) -> bool:
    """Return whether the path is coloured by margins."""
    return snapshot.view.step == "roll" and snapshot.session.results.roll is not None


def shows_second_path(snapshot: Snapshot) -> bool:
    """Return whether the second path is shown: selected, or not yet scanned."""
    return snapshot.view.second or snapshot.session.captures.second is None


def tilt_scale_max_deg(view: SecondView) -> float:
    """Return the tilt at the end of the colour scale, degrees."""
    return float(np.ceil(view.lean_deg.max(initial=1.0)))
