"""Path that is shown: computed or previewed, its colour scales, and the path of the second pass."""

import numpy as np

from rona_core.app.steps.maps.second_pass_view import SecondView
from rona_core.app.steps.path.view import PathView, path_view, preview_path
from rona_core.app.steps.roll.margins_view import Quantity
from rona_ui.presentation.snapshot import Snapshot

# value at the end of the colour scale
MARGIN_SCALE_MAX: dict[Quantity, float] = {
    "room": 2.0,
    "limits": 45.0,
    "singularity": 3.0,
    "clearance": 50.0,
}


def shown_path(snapshot: Snapshot) -> PathView | None:
    """Return the path to be shown: that of the slider while it is dragged, else the computed."""
    if snapshot.preview_mm is not None:
        return preview_path(snapshot.session, snapshot.preview_mm)
    return path_view(snapshot.session)


def shown_path_key(snapshot: Snapshot) -> tuple[int, int, float | None]:
    """Return what tells one shown path from another."""
    results = snapshot.session.results
    return id(results.path), id(results.smoothing), snapshot.preview_mm


def shows_margins(snapshot: Snapshot) -> bool:
    """Return whether the path is drawn by its margins in place of its plain colour."""
    return snapshot.view.step == "roll" and snapshot.session.results.roll is not None


def shows_second_path(snapshot: Snapshot) -> bool:
    """Return whether that pass is looked at or still to be scanned, so that its path matters."""
    return snapshot.view.second or snapshot.session.captures.second is None


def tilt_scale_max_deg(view: SecondView) -> float:
    """Return where the colours of the lean end."""
    return float(np.ceil(view.lean_deg.max(initial=1.0)))
