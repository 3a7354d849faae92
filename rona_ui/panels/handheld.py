"""Handheld probe (SonoPointer): calibrate, scan, map."""

from typing import Any

from rona_core.app.declarations.figures import HANDHELD
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.viewer.bindings import escape

EXPLANATION = "The tracked probe in the hand produces the same maps without the robot."
SOURCES = {"Robot scan": False, "Handheld scan": True}


class HandheldControls:
    """Buttons to calibrate, scan and map by hand, each with its result."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        with gui.add_folder("Handheld scan (SonoPointer)", expand_by_default=False):
            gui.add_html(style.text(EXPLANATION))
            self._calibrate = context.send_button(
                gui, "1. Calibrate probe", "target", StartHandheldCalibration
            )
            self._probe = gui.add_html("")
            form = self._form = Form(gui)
            form.of(StartHandheldScan, "duration_s", "spacing_mm")
            self._scan = context.send_button(
                gui,
                "2. Start handheld scan",
                "hand-grab",
                lambda: StartHandheldScan(**form.values()),
            )
            self._scan_text = gui.add_html("")
            self._map = gui.add_button("3. Map handheld scan", icon="map", color="gray")
            on_click(self._map, self._mapped)
            self._maps = gui.add_html("")
            self._shown = gui.add_dropdown("Show maps of", tuple(SOURCES))
        on_change(self._shown, lambda e: context.set_view(handheld=SOURCES[self._shown.value]))

    def _mapped(self, event: Any) -> None:
        self._context.send(StartHandheldMapping, event)
        self._context.set_view(handheld=True)

    def render(self, new: Snapshot) -> None:
        """Show what can be done now, and what is there."""
        session, busy = new.session, new.busy
        results, scanned = session.results, session.captures.sono_scan is not None
        self._form.enable(not busy)
        self._calibrate.disabled = busy
        self._scan.disabled = busy or results.sono is None
        self._map.disabled = busy or results.sono is None or not scanned
        self._shown.visible = results.sono_maps is not None and results.maps is not None
        self._probe.content = _probe(session)
        self._scan_text.content = _scan_text(session)
        self._maps.content = _maps(new)


def _stale(name: str, session: Session) -> str:
    reason = stale_reason(name, session)
    return "" if reason is None else style.note(f"Stale: {reason}. Repeat this step.", "warn")


def _probe(session: Session) -> str:
    made = session.results.sono
    if made is None:
        return style.text(
            "Pivots the probe on a calibration point, then rotates it about its axis in a bushing."
        )
    found = made.value
    words = (
        f"Probe face σ {found.face_sigma_mm:.2f} mm, axis σ {found.axis_sigma_deg:.2f} deg "
        f"(random errors), rotation of {found.spin_deg:.0f} deg."
    )
    if found.verdict != "good":
        return style.note(f"{words} {'; '.join(found.reasons)}.", "warn") + _stale("sono", session)
    return _stale("sono", session) or style.note(words, "good")


def _scan_text(session: Session) -> str:
    capture = session.captures.sono_scan
    if capture is None:
        return style.text("Scan with gel, probe upright, light pressure.")
    seen = 100.0 * len(capture.marker.times_s) / max(capture.marker.n_frames, 1)
    words = f"{len(capture.scans)} A-scans; probe visible in {seen:.0f} % of the frames."
    return _stale("capture sono_scan", session) or style.text(words)


def _maps(snapshot: Snapshot) -> str:
    made = snapshot.session.results.sono_maps
    if made is None:
        return ""
    maps, figures = made.value, snapshot.figures
    words = f"{maps.n_posed} of {maps.n_scans} A-scans have a pose. {maps.sentence}"
    rows = [
        (escape(one.title), f"<b>{one.words(value)}</b>")
        for one in HANDHELD
        if one.of == "sono_maps" and isinstance(value := figures.get(one.key), float)
    ]
    table = style.table(("", "n"), (), rows) if rows else ""
    return (_stale("sono_maps", snapshot.session) or style.text(words)) + table
