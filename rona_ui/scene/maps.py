"""Outer, inner and fused boundary map as unlit points in viridis, and the A-scans' places."""

import numpy as np

from rona_core.app.maps import map_layers
from rona_core.app.views import scan_number_at, scan_poses
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import GREEN, SKY, VERMILLION, YELLOW, viridis
from rona_ui.scene.metres import Stage
from rona_ui.view_state import Picture

SCAN, NOW = "/scan/points", "/scan/now"


class MapLayer(Layer):
    """Draws one of the three maps."""

    def __init__(self, stage: Stage, name: str) -> None:
        super().__init__(stage)
        self.layer = name

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the map where it or its quantity is another one."""
        node, maps = f"/maps/{self.layer}", new.session.results.maps
        if (
            old is None
            or old.session.results.maps is not maps
            or old.view.quantity != new.view.quantity
        ):
            shown = map_layers(new.session, new.view.quantity)
            if shown is None:
                self.stage.remove(node)
            else:
                part = shown.part(self.layer)
                share = (part.values_mm - shown.low_mm) / (shown.high_mm - shown.low_mm)
                self.stage.cloud(node, part.points_base, viridis(share), size_mm=part.cell_mm)
        self.stage.show(node, self.shown(new))


class ScanLayer(Layer):
    """Draws where A-scans were taken: green where the inner boundary was found, red where not."""

    layer = "scan"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the points of the scan, and the one under the replay cursor."""
        before = None if old is None else old.session
        scan, detection = new.session.captures.scan, new.session.results.detection
        redrawn = (
            before is None
            or before.captures.scan is not scan
            or before.results.detection is not detection
        )
        moved = old is None or old.view.cursor != new.view.cursor
        if redrawn or moved:
            poses = scan_poses(new.session)
            places = np.zeros((0, 3)) if poses is None else poses.translations
            if redrawn:
                colors = np.tile(np.array(SKY, dtype=np.uint8), (len(places), 1))
                if detection is not None and len(detection.value.inner_ok) == len(places):
                    found = detection.value.inner_ok[:, None]
                    colors = np.where(found, GREEN, VERMILLION).astype(np.uint8)
                self.stage.cloud(SCAN, places, colors, size_mm=0.9)
            number = None if new.view.cursor is None else _number(new)
            mark = places[number : number + 1] if number is not None else places[:0]
            self.stage.cloud(NOW, mark, YELLOW, size_mm=3.0)
        self.stage.show(SCAN, self.shown(new))
        self.stage.show(NOW, self.shown(new))


def _number(picture: Picture) -> int | None:
    return scan_number_at(picture.session, picture.view.cursor or 0.0)
