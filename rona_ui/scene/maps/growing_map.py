"""Step 8: the outer map while it grows, in viridis."""

from rona_ui.presentation.colors import viridis
from rona_ui.presentation.shown import shown_growing_map
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer, lift

NODE = "/scan/growing"
SIZE_MM = 1.2
LIFT_MM = 2.2  # so that neither the skull nor the path hides it


class GrowingMapLayer(Layer):
    """Draws the outer boundary as far as the robot has scanned it."""

    layer = "scan"

    def shown(self, snapshot: Snapshot) -> bool:
        """Show it in every step while the robot scans, afterwards where A-scans are shown."""
        wanted = snapshot.scanning and self.layer not in snapshot.view.hidden
        return wanted or super().shown(snapshot)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the map where it has grown; remove it once there is a real one."""
        growing = shown_growing_map(new)
        if growing is None:
            self.nodes.remove(NODE)
            return
        if old is None or shown_growing_map(old) is not growing:
            share = (growing.heights_mm - growing.low_mm) / (growing.high_mm - growing.low_mm)
            points = growing.points_base + lift(new, LIFT_MM)
            self.nodes.cloud(NODE, points, viridis(share), size_mm=SIZE_MM)
        self.nodes.show(NODE, self.shown(new))
