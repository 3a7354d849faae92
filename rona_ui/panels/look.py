"""How this browser looks at the scene: camera presets and layers."""

from dataclasses import replace
from typing import Any

from rona_ui.panels.door import Door, follow, listen
from rona_ui.view_state import LAYERS, Picture

PRESETS = (("Overview", "Region", "Top"), ("Left", "Right", "Robot"))
MAPS = ("outer", "inner", "fused")  # chosen in step 9


class LookPanel:
    """Buttons for the camera, ticks for the layers."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._ticks: dict[str, Any] = {}
        with gui.add_folder("View", expand_by_default=False):
            for number, names in enumerate(PRESETS):
                group = gui.add_button_group("Camera" if number == 0 else " ", names)
                self._camera(group, door)
            everything = gui.add_checkbox(
                "All layers", False, hint="Also those that the active step does not need"
            )
            follow(
                everything, lambda e: door.view(lambda v: replace(v, everything=everything.value))
            )
            for name, title in LAYERS.items():
                if name not in MAPS:
                    self._ticks[name] = gui.add_checkbox(title, True)
                    self._layer(name, self._ticks[name], door)

    @staticmethod
    def _camera(group: Any, door: Door) -> None:
        listen(group, lambda e: door.look(group.value))

    @staticmethod
    def _layer(name: str, tick: Any, door: Door) -> None:
        def change(event: Any) -> None:
            only = frozenset((name,))
            door.view(
                lambda v: replace(v, hidden=v.hidden - only if tick.value else v.hidden | only)
            )

        follow(tick, change)

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow the layers."""
        if old is None or old.view.hidden != new.view.hidden:
            for name, tick in self._ticks.items():
                tick.value = name not in new.view.hidden
