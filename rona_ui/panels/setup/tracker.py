"""Tracker settings of step 1."""

from dataclasses import asdict
from typing import Any

from rona_core.app.steps.setup.messages import MoveTracker, SetTracker, SetUseBaseMarker
from rona_core.devices.settings import TrackerSettings
from rona_ui.panels.widgets.form import SettingsForm
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.presentation.snapshot import Snapshot

DETAILS = (
    "stereo",
    "depth_ratio",
    "occlusion",
    "latency_ms",
    "dropped_share",
    "phantom_share",
    "drift_mm",
    "minutes_on",
)


class TrackerFields:
    """Profile, details and place of the tracker."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._gui, self._context = gui, context
        self._tracker = SettingsForm(
            gui,
            context,
            SetTracker,
            lambda session: session.setup.devices.tracker,
            "profile",
            "rate_hz",
            make=_message,
            show=lambda held: {**asdict(held), "latency_ms": 1000.0 * held.latency_s},
        )

    def build_details(self) -> None:
        """Add what makes the virtual tracker like a real one."""
        self._tracker.add(*DETAILS)

    def build_place(self) -> None:
        """Add where the tracker stands, and whether it is found again once it has moved."""
        self._place = SettingsForm(
            self._gui,
            self._context,
            MoveTracker,
            lambda session: session.setup.devices.tracker.place,
        )
        self._marker = SettingsForm(
            self._gui, self._context, SetUseBaseMarker, lambda session: session.setup
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the session."""
        for form in (self._tracker, self._place, self._marker):
            form.render(old, new)


def _message(held: TrackerSettings, values: dict[str, Any]) -> SetTracker:
    """Return the command of the rows; the latency of the profile is left to the profile."""
    if values["profile"] != held.profile:
        values["latency_ms"] = None
    elif values["latency_ms"] == 1000.0 * held.latency_s:
        values["latency_ms"] = held.latency_ms
    return SetTracker(**values)
