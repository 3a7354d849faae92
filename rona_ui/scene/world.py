"""The whole scene of one browser: all adapters, drawn together."""

from typing import Any

import numpy as np

from rona_ui.scene.adapter import Adapter
from rona_ui.scene.colors import BACKGROUND
from rona_ui.scene.maps.map_section import ProfileLayer
from rona_ui.scene.maps.maps import MapLayer, ScanLayer
from rona_ui.scene.maps.reference_points import ReferencesLayer
from rona_ui.scene.maps.second_pass import SecondLayer
from rona_ui.scene.path.path import AxesLayer, PathLayer, WarningsLayer
from rona_ui.scene.path.path_editing import EditLayer
from rona_ui.scene.pointer.pivot_handles import NODE as TURN
from rona_ui.scene.pointer.pivot_handles import TurnLayer
from rona_ui.scene.pointer.pointer import DrawingLayer, PointerLayer
from rona_ui.scene.roll.base_places import PlacesLayer
from rona_ui.scene.roll.margins import MarginsLayer
from rona_ui.scene.roll.rolls import RollsLayer
from rona_ui.scene.setup.clearance import NearLayer, ObstaclesLayer
from rona_ui.scene.setup.robot import RobotLayer
from rona_ui.scene.setup.skull import NODE, SkullLayer
from rona_ui.scene.setup.tracker import TrackerLayer
from rona_ui.scene.surface.cloud import CloudLayer, RegionLayer
from rona_ui.scene.surface.registered_skull import GhostLayer
from rona_ui.scene.viser_nodes import Stage
from rona_ui.view_state import Picture

FLOOR_MM = -420.0  # the robot stands on a pedestal of about its base's height


class World:
    """Draws pictures into the scene of one browser."""

    def __init__(self, scene: Any) -> None:
        self.stage = Stage(scene)
        scene.set_background_image(np.full((4, 4, 3), BACKGROUND, dtype=np.uint8))
        scene.configure_default_lights(cast_shadow=False)
        self.stage.floor("/floor", FLOOR_MM)
        self._adapters: tuple[Adapter, ...] = (
            SkullLayer(self.stage),
            RobotLayer(self.stage),
            NearLayer(self.stage),
            ObstaclesLayer(self.stage),
            TrackerLayer(self.stage),
            PointerLayer(self.stage),
            TurnLayer(self.stage),
            RegionLayer(self.stage),
            CloudLayer(self.stage),
            GhostLayer(self.stage),
            DrawingLayer(self.stage),
            PathLayer(self.stage),
            AxesLayer(self.stage),
            WarningsLayer(self.stage),
            EditLayer(self.stage),
            RollsLayer(self.stage),
            MarginsLayer(self.stage),
            PlacesLayer(self.stage, FLOOR_MM),
            ScanLayer(self.stage),
            *(MapLayer(self.stage, name) for name in ("outer", "inner", "fused")),
            ProfileLayer(self.stage),
            SecondLayer(self.stage),
            ReferencesLayer(self.stage),
        )

    def render(self, old: Picture | None, new: Picture) -> None:
        """Bring the scene from ``old`` to ``new``."""
        for adapter in self._adapters:
            adapter.render(old, new)

    def skull(self) -> Any:
        """Return the viewer's handle of the skull, or None while it is not there."""
        return self.stage.node(NODE) if NODE in self.stage.names() else None

    def arcs(self) -> Any:
        """Return the viewer's handle of the arcs about the pointer's tip, or None."""
        return self.stage.node(TURN) if TURN in self.stage.names() else None
