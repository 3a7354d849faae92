"""Scene renderer: lights, and every layer of one browser from snapshots."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import BACKGROUND, Rgb
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.implant import (
    BedLayer,
    ChanceLayer,
    ExpectedOutlineLayer,
    ImplantLayer,
    MilledBoneLayer,
    MillingLayer,
    MovedBedLayer,
    UnmappedLayer,
)
from rona_ui.scene.maps.maps import (
    GrowingMapLayer,
    MapLayer,
    ProfileLayer,
    ReferencesLayer,
    ScanLayer,
    SecondLayer,
)
from rona_ui.scene.maps.volume import VolumeLayer
from rona_ui.scene.path.path import (
    AxesLayer,
    EditLayer,
    PaintedLayer,
    PathLayer,
    SmoothLayer,
    WarningsLayer,
)
from rona_ui.scene.pointer import (
    PIVOT_HANDLES,
    CloudLayer,
    DrawingLayer,
    LandmarkLayer,
    PivotHandlesLayer,
    PointerLayer,
    RegionLayer,
    RegisteredSkullLayer,
    StrokeLayer,
)
from rona_ui.scene.roll import MarginsLayer, PlacesLayer, RollsLayer
from rona_ui.scene.setup.robot import ClearanceLayer, ObstaclesLayer, RobotLayer
from rona_ui.scene.setup.room import RoomLayer
from rona_ui.scene.setup.skull import NODE, HeadLayer, SkullLayer
from rona_ui.scene.setup.tracker import LabelsLayer, SightLayer, TrackerLayer
from rona_ui.scene.viser_nodes import M_PER_MM, Layer, SceneNodes

SKY, GROUND, AROUND = (255, 255, 255), (150, 146, 142), 1.5  # from above, from below, strength
# direction to the lamp in base, its colour and its strength; from the side of the cameras, so that
# relief on the region throws shades and no face of a thing is black
LAMPS: tuple[tuple[tuple[float, float, float], Rgb, float], ...] = (
    ((-0.35, -0.85, 0.75), (255, 250, 242), 2.1),
    ((0.8, 0.5, 0.5), (232, 240, 255), 0.5),
)


def light(scene: Any) -> None:
    """Light a scene of the viewer, in place of its own lamps and surroundings."""
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(hdri=None)
    scene.add_light_hemisphere(
        "/lights/around", sky_color=SKY, ground_color=GROUND, intensity=AROUND
    )
    for number, (towards, color, strength) in enumerate(LAMPS):
        scene.add_light_directional(
            f"/lights/lamp{number}",
            color=color,
            intensity=strength,
            position=tuple(10.0 * unit(towards)),
        )


def unit(direction: ArrayLike) -> Floats:
    """Return a direction (3,) of length 1."""
    along = np.asarray(direction, dtype=np.float64)
    return along / np.linalg.norm(along)


FLOOR_MM = -420.0  # the robot stands on a pedestal of about its base's height


class SceneRenderer:
    """Draws snapshots into the scene of one browser."""

    def __init__(self, scene: Any, boundary: ErrorBoundary) -> None:
        self._boundary = boundary
        self.nodes = SceneNodes(scene)
        scene.set_background_image(np.full((4, 4, 3), BACKGROUND, dtype=np.uint8))
        light(scene)
        self._stale: dict[Layer, bool] = {}
        self._layers: tuple[Layer, ...] = (
            RoomLayer(self.nodes, FLOOR_MM),
            SkullLayer(self.nodes),
            HeadLayer(self.nodes),
            RobotLayer(self.nodes),
            ClearanceLayer(self.nodes),
            ObstaclesLayer(self.nodes),
            TrackerLayer(self.nodes, FLOOR_MM),
            SightLayer(self.nodes),
            PointerLayer(self.nodes),
            PivotHandlesLayer(self.nodes),
            RegionLayer(self.nodes),
            CloudLayer(self.nodes),
            StrokeLayer(self.nodes),
            RegisteredSkullLayer(self.nodes),
            DrawingLayer(self.nodes),
            PathLayer(self.nodes),
            SmoothLayer(self.nodes),
            AxesLayer(self.nodes),
            WarningsLayer(self.nodes),
            EditLayer(self.nodes),
            PaintedLayer(self.nodes),
            ExpectedOutlineLayer(self.nodes),
            RollsLayer(self.nodes),
            MarginsLayer(self.nodes),
            PlacesLayer(self.nodes, FLOOR_MM),
            LandmarkLayer(self.nodes),
            ScanLayer(self.nodes),
            GrowingMapLayer(self.nodes),
            *(MapLayer(self.nodes, name) for name in ("outer", "inner", "fused")),
            ProfileLayer(self.nodes),
            SecondLayer(self.nodes),
            ReferencesLayer(self.nodes),
            VolumeLayer(self.nodes),
            BedLayer(self.nodes),
            ImplantLayer(self.nodes),
            UnmappedLayer(self.nodes),
            MovedBedLayer(self.nodes),
            MillingLayer(self.nodes),
            MilledBoneLayer(self.nodes),
            ChanceLayer(self.nodes),
            LabelsLayer(self.nodes),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring the scene from ``old`` to ``new``."""
        with self.nodes.sent_when_seen():
            for layer in self._layers:
                stale = layer.stale(new)
                turned = self._stale.get(layer, stale) != stale
                self._stale[layer] = stale
                with self.nodes.drawn_as_stale(stale):
                    self._boundary.draw(layer, None if turned else old, new)

    def skull(self) -> Any:
        """Return the viewer's handle of the skull, or None while it is not there."""
        return self.nodes.node(NODE)

    def pivot_handles(self) -> Any:
        """Return the viewer's handle of the pivot handles, or None."""
        return self.nodes.node(PIVOT_HANDLES)

    def pivot_tip_base(self) -> Floats | None:
        """Return where the pivot handles stand (3,), or None."""
        handles = self.pivot_handles()
        return None if handles is None else np.asarray(handles.position) / M_PER_MM
