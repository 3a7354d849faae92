"""Footprint on the bone of what the mouse stands for: the face of the probe, or the brush."""

from typing import Any

from rona_core.ultrasound.probe.probe_model import probe_model
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import PAINTING


def footprint(snapshot: Snapshot) -> dict[str, Any] | None:
    """Return its width (mm) and the place in ``base`` (mm) at whose distance it is meant.

    None in modes that mean a point.
    """
    view, scene = snapshot.view, snapshot.static_scene
    if scene is None:
        return None
    if view.drawing == "path":
        radius_mm = probe_model(snapshot.session.setup.devices.probe).aperture_radius_mm
    elif view.drawing in PAINTING:
        radius_mm = view.brush_mm
    else:
        return None
    return {"width_mm": 2.0 * radius_mm, "place_mm": scene.region_center_base.tolist()}
