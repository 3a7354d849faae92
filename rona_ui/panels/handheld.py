"""The probe in the hand (SonoPointer): calibrate it, scan with it, map what it heard."""

from dataclasses import replace
from typing import Any

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import Door, follow, listen
from rona_ui.view_state import Picture
from rona_ui.viewer.bindings import escape

WHOSE = {"Robot's scan": False, "Scan by hand": True}
LINES = (  # title, key of the figure, unit
    ("Outer boundary, RMS", "sono_outer_rms_mm", " mm"),
    ("Inner boundary, RMS", "sono_inner_rms_mm", " mm"),
    ("Thickness, RMS", "sono_thickness_rms_mm", " mm"),
    ("Coverage, outer", "sono_coverage_fraction", ""),
    ("Coverage, inner", "sono_inner_coverage_fraction", ""),
)


class SonoControls:
    """Three buttons in the order in which they are pressed, and what came of each."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._door = door
        start = StartHandheldScan()
        with gui.add_folder("Scan by hand (SonoPointer)", expand_by_default=False):
            gui.add_html(
                style.text(
                    "The same probe, tracked in the hand, makes the same maps without the robot."
                )
            )
            self._calibrate = gui.add_button("1. Calibrate the probe", icon="target", color="gray")
            self._probe = gui.add_html("")
            form = self._form = Form(gui)
            form.number("duration_s", "Duration (s)", start.duration_s, 5.0, 600.0, 5.0)
            form.number(
                "spacing_mm", "Lines (mm)", start.spacing_mm, 0.5, 10.0, 0.5, "Between two lines"
            )
            self._scan = gui.add_button("2. Scan by hand", icon="hand-grab", color="gray")
            self._heard = gui.add_html("")
            self._map = gui.add_button("3. Map the scan by hand", icon="map", color="gray")
            self._maps = gui.add_html("")
            self._whose = gui.add_dropdown("Show maps of", tuple(WHOSE))
        listen(self._calibrate, lambda e: door.send(StartHandheldCalibration, e))
        listen(self._scan, lambda e: door.send(self.scan, e))
        listen(self._map, self._mapped)
        follow(self._whose, lambda e: self._choose())

    def scan(self) -> Any:
        """Return the scan with these parameters."""
        return StartHandheldScan(**self._form.values())

    def _mapped(self, event: Any) -> None:
        self._door.send(StartHandheldMapping, event)
        self._door.view(lambda v: replace(v, by_hand=True))

    def _choose(self) -> None:
        by_hand = WHOSE[self._whose.value]
        self._door.view(lambda v: replace(v, by_hand=by_hand))

    def render(self, new: Picture) -> None:
        """Show what can be done now, and what is there."""
        session, busy = new.session, new.busy
        results, scanned = session.results, session.captures.sono_scan is not None
        self._form.enable(not busy)
        self._calibrate.disabled = busy
        self._scan.disabled = busy or results.sono is None
        self._map.disabled = busy or results.sono is None or not scanned
        self._whose.visible = results.sono_maps is not None and results.maps is not None
        for html, words in (
            (self._probe, _probe(session)),
            (self._heard, _heard(session)),
            (self._maps, _maps(new)),
        ):
            if html.content != words:
                html.content = words


def _stale(name: str, session: Session) -> str:
    reason = stale_reason(name, session)
    return "" if reason is None else style.note(f"Stale: {reason}. Do it again.", "warn")


def _probe(session: Session) -> str:
    made = session.results.sono
    if made is None:
        return style.text("Pivots on a calibration point, then turns about its axis in a bush.")
    found = made.value
    words = (
        f"Face known to {found.face_sigma_mm:.2f} mm (random error), axis to "
        f"{found.axis_sigma_deg:.2f} deg, from a turn of {found.spin_deg:.0f} deg."
    )
    if found.verdict != "good":
        return style.note(f"{words} {'; '.join(found.reasons)}.", "warn") + _stale("sono", session)
    return _stale("sono", session) or style.note(words, "good")


def _heard(session: Session) -> str:
    capture = session.captures.sono_scan
    if capture is None:
        return style.text("With gel, upright, lightly pressed on.")
    seen = 100.0 * len(capture.marker.times_s) / max(capture.marker.n_frames, 1)
    words = f"{len(capture.scans)} A-scans; the probe was seen in {seen:.0f} % of the frames."
    return _stale("capture sono_scan", session) or style.text(words)


def _maps(picture: Picture) -> str:
    made = picture.session.results.sono_maps
    if made is None:
        return ""
    value, figures = made.value, picture.figures
    words = f"{value.n_posed} of {value.n_scans} A-scans have a pose. {value.sentence}"
    rows = "".join(
        f'<tr><td>{escape(title)}</td><td class="n"><b>{figures[key]:.2f}{unit}</b></td></tr>'
        for title, key, unit in LINES
        if isinstance(figures.get(key), float)
    )
    table = f'<table class="r-table">{rows}</table>' if rows else ""
    return (_stale("sono_maps", picture.session) or style.text(words)) + table
