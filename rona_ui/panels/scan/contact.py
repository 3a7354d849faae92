"""How the probe is pressed on, in step 8: set point in sight, limits in a closed folder."""

from typing import Any

from rona_core.app.steps.scan.contact_view import contact_report, delay_sentence
from rona_core.app.steps.setup.contact_messages import SetContact
from rona_core.devices.settings import ContactSettings
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import Door
from rona_ui.view_state import Picture
from rona_ui.viewer.bindings import Event

STANDARD = ContactSettings()


class ContactFields:
    """Fields of their own command; every change is sent."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._door = door
        form = self._form = Form(gui)
        form.tick("pressed", "Press the probe on", True, "Off: driven by position alone")
        form.number("force_n", "Force (N)", STANDARD.force_n, 0.5, 8.0, 0.5, "Along the tool axis")
        with gui.add_folder("Limits of the contact", expand_by_default=False):
            form.number("travel_mm", "Correction (mm)", STANDARD.travel_mm, 1.0, 10.0, 0.5)
            form.number("monitor_n", "Yield above (N)", STANDARD.monitor_n, 1.5, 30.0, 0.5)
            form.number("stop_n", "Stop above (N)", STANDARD.stop_n, 2.5, 50.0, 0.5)
            form.number(
                "approach_mm_per_s", "Touch down (mm/s)", STANDARD.approach_mm_per_s, 0.2, 10.0, 0.2
            )
            form.number("period_ms", "Control every (ms)", STANDARD.period_ms, 1.0, 50.0, 1.0)
            form.number("delay_ms", "Robot delay (ms)", STANDARD.delay_ms, 0.0, 200.0, 1.0)
            form.number("lag_ms", "Robot lag (ms)", STANDARD.lag_ms, 1.0, 200.0, 1.0)
        form.on_change(self._changed)

    def _changed(self, name: str, event: Event) -> None:
        self._door.send_settled("contact", self._message, event)

    def _message(self) -> SetContact:
        return SetContact(**self._form.values())

    def render(self, old: Picture | None, new: Picture) -> None:
        """Write what the session holds into the fields where it has changed or was refused."""
        if old is None or old.busy != new.busy:
            self._form.enable(not new.busy)
        if old is None or old.session.setup is not new.session.setup or old.refused != new.refused:
            self._form.show(held(new.session))


def held(session: Session) -> dict[str, Any]:
    """Return what the fields show: the limits stay as they are where nothing is pressed on."""
    contact = session.setup.devices.robot.contact
    if contact is None:
        return {"pressed": False}
    names = (
        "force_n",
        "travel_mm",
        "monitor_n",
        "stop_n",
        "approach_mm_per_s",
        "period_ms",
        "delay_ms",
        "lag_ms",
    )
    return {"pressed": True, **{name: getattr(contact, name) for name in names}}


def contact_note(session: Session) -> str:
    """Return how the last scan was pressed on, and how late its poses were, as HTML."""
    report = contact_report(session)
    if report is None:
        return ""
    ended = report.contact is not None and bool(report.contact.reason)
    words = style.note(report.sentence, "warn" if ended else "")
    return words + (style.text(delay_sentence(report.delay)) if report.delay is not None else "")
