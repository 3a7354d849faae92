"""Tracker settings of step 1."""

from typing import Any

from rona_core.app.steps.setup.messages import MoveTracker, SetTracker
from rona_core.devices.settings import TrackerSettings
from rona_ui.panels.widgets.form import Form

PROFILES = {
    "Polaris (0.35 mm RMS)": "polaris",
    "Spectra (0.25 mm RMS)": "spectra",
    "Vega (0.12 mm RMS)": "vega",
    "White noise 0.35 mm": "white035",
    "Without noise": "ideal",
}
SWITCHED_ON = "From switch-on to the first capture"
DEPTH = "Ratio of depth error to lateral error"
DETAILS = (
    ("latency_ms", "Latency (ms)", 0.0, 0.0, 200.0, 1.0, "A new profile sets its own value"),
    ("dropped_percent", "Frame loss (%)", 0.0, 0.0, 50.0, 1.0, "Share of lost frames"),
    ("phantom_percent", "Ghost solutions (%)", 0.0, 0.0, 20.0, 1.0, "5D tools seen reversed"),
    ("drift_mm", "Warm-up drift (mm)", 0.0, 0.0, 2.0, 0.1, "At switch-on; decays with time"),
    ("minutes_on", "Warm-up time (min)", 60.0, 0.0, 600.0, 1.0, SWITCHED_ON),
)
PERCENT = {"phantom_percent": "phantom_share", "dropped_percent": "dropped_share"}
PLAIN = ("profile", "rate_hz", "stereo", "depth_ratio", "occlusion", "drift_mm", "minutes_on")
NAMES = (*PLAIN, *PERCENT, "latency_ms")
PLACE = ("tracker_shift_mm", "tracker_turn_deg")


class TrackerFields:
    """Fields that together make one ``SetTracker``."""

    def __init__(self, form: Form) -> None:
        self._form = form
        self._latency_ms: float | None = None  # None: that of the profile

    def build(self) -> None:
        """Add profile and rate."""
        self._form.choice("profile", "Tracker", PROFILES, "polaris")
        self._form.number("rate_hz", "Rate (Hz)", 60.0, 20.0, 60.0, 1.0)

    def build_details(self) -> None:
        """Add what makes the virtual tracker like a real one."""
        form = self._form
        form.tick("stereo", "Stereo error model", True, "Error grows with the distance")
        form.number("depth_ratio", "Depth ratio", 3.0, 1.0, 8.0, 0.5, DEPTH)
        form.tick("occlusion", "Simulate occlusion", True, "Head, robot and hand hide markers")
        form.numbers(*DETAILS)

    def build_place(self) -> None:
        """Add where the tracker stands, and whether it is found again once it has moved."""
        form = self._form
        form.vector(
            "tracker_shift_mm", "Tracker shift (mm)", (0.0, 0.0, 0.0), "Along x, y, z of the base"
        )
        form.number(
            "tracker_turn_deg",
            "Tracker rotation (deg)",
            0.0,
            -20.0,
            20.0,
            0.5,
            "About the vertical",
        )
        hint = "Locates a displaced tracker, with some loss of accuracy"
        form.tick("use_base_marker", "Base marker", True, hint)

    def place(self) -> MoveTracker:
        """Return the command that the fields of the place make."""
        values = self._form.values(*PLACE)
        return MoveTracker(values["tracker_shift_mm"], values["tracker_turn_deg"])

    def changed(self, name: str) -> None:
        """Note that a field was changed: a new profile brings its own latency."""
        if name == "profile":
            self._latency_ms = None
        elif name == "latency_ms":
            self._latency_ms = float(self._form.value("latency_ms"))

    def message(self) -> SetTracker:
        """Return the command that the fields make."""
        values = self._form.values(*PLAIN, *PERCENT)
        shares = {share: round(values.pop(name) / 100.0, 9) for name, share in PERCENT.items()}
        return SetTracker(**values, **shares, latency_ms=self._latency_ms)

    def field_values(self, settings: TrackerSettings) -> dict[str, Any]:
        """Return what the fields are to show of a session's settings."""
        self._latency_ms = settings.latency_ms
        shown = {name: getattr(settings, name) for name in PLAIN}
        shown |= {
            name: round(100.0 * getattr(settings, share), 7) for name, share in PERCENT.items()
        }
        place = settings.place
        shown |= {"tracker_shift_mm": place.shift_mm, "tracker_turn_deg": place.turn_deg}
        return shown | {"latency_ms": 1000.0 * settings.latency_s}
