"""Where to put the robot: search places of its base, and move it to one by a click (step 7)."""

from typing import Any

from rona_core.app.steps.roll.base_placement import moves
from rona_core.app.steps.roll.base_placement_view import BasePlace, BasePlacement, fresh_placement
from rona_core.app.steps.roll.messages import ApplyBasePlacement, StartBasePlacement
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import Door, listen
from rona_ui.scene.colors import ORANGE, SKY, VERMILLION, css, viridis_css
from rona_ui.scene.roll.base_places import NEAR
from rona_ui.view_state import Picture

AGAIN = (
    "The tracker is registered to the base: after a move do steps 2 and 4 to 7 again (the pointer "
    "stays calibrated)."
)


class BasePlaceControls:
    """A button that searches, a summary, and a button for each place that was certified."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._search = gui.add_button("Where to put the robot?", icon="map-search", color="gray")
        self._words = gui.add_html("")
        self._take = {
            "smallest": gui.add_button("Take the smallest move", icon="check", visible=False),
            "best": gui.add_button("Take the most room", icon="check", visible=False),
        }
        self._key = gui.add_html("")
        self._form = Form(gui)
        with gui.add_folder("Where to look", expand_by_default=False):
            form = self._form
            form.number("half_x_mm", "To and fro (mm)", 500.0, 0.0, 2000.0, 50.0, "Along base x")
            form.number("half_y_mm", "To the sides (mm)", 600.0, 0.0, 2000.0, 50.0, "Along base y")
            form.number("step_mm", "Cells of (mm)", 100.0, 25.0, 500.0, 25.0)
        listen(self._search, lambda e: door.send(self._message, e))
        listen(
            self._take["smallest"], lambda e: door.send(lambda: ApplyBasePlacement("smallest"), e)
        )
        listen(self._take["best"], lambda e: door.send(lambda: ApplyBasePlacement("best"), e))

    def _message(self) -> StartBasePlacement:
        return StartBasePlacement(**self._form.values())

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow the search, and rest while something runs."""
        if old is not None and old.session is new.session and old.busy == new.busy:
            return
        found = fresh_placement(new.session)
        self._search.disabled = new.busy or new.step("roll").state == "blocked"
        self._form.enable(not new.busy)
        offered = {} if found is None else offers(found)
        for name, button in self._take.items():
            button.visible, button.disabled = name in offered, new.busy
        words = placement_words(new.session, found)
        for html, content in ((self._words, words), (self._key, placement_key(found))):
            if html.content != content:
                html.content = content


def offers(found: BasePlacement) -> dict[str, BasePlace]:
    """Return the places that can be taken; one that is both is offered once."""
    smallest, best = found.smallest, found.best
    both = {"smallest": smallest, "best": None if best is smallest else best}
    return {name: place for name, place in both.items() if place is not None and moves(place)}


def placement_words(session: Session, found: BasePlacement | None) -> str:
    """Return what the search found, as HTML."""
    if found is None:
        return _past_words(session)
    offered = offers(found)
    words = ""
    if found.smallest is None:
        reasons = "; ".join(found.reasons)
        words += style.note(f"No place was found that is certified: {reasons}.", "warn")
    elif not moves(found.smallest):
        words += style.note("The scan is certified from where the base stands.", "good")
    for name, title in (("smallest", "Smallest move"), ("best", "Most room")):
        if name in offered:
            words += style.note(f"{title}: {place_words(offered[name])}", "good")
    return words + (style.text(AGAIN) if offered else "")


def _past_words(session: Session) -> str:
    """Return what is left to say of a search that no longer holds."""
    searched, robot = session.results.placement, session.setup.devices.robot
    if searched is None:
        return ""
    stands = robot.base_shift_mm, robot.base_turn_deg
    if any((place.shift_mm, place.turn_deg) == stands for place in offers(searched.value).values()):
        return style.note("The base stands at the place that was chosen. " + AGAIN)
    return style.note(
        "The base, the path or what stands around has changed: look again for places."
    )


def placement_key(found: BasePlacement | None) -> str:
    """Return the legend of the map on the floor."""
    if found is None:
        return ""
    legend = (
        f'<div class="r-key"><span><i style="width:44px;background:{viridis_css()}"></i>'
        f"on the floor: seems to work, room 0 to {_top(found):.1f}</span></div>"
    )
    others = [(css(VERMILLION), "does not"), (css(NEAR), "too near the head")]
    marks = {"smallest": (css(ORANGE), "smallest move"), "best": (css(SKY), "most room")}
    return legend + style.key(tuple(others + [marks[name] for name in offers(found)]))


def place_words(place: BasePlace) -> str:
    """Return a place in plain words."""
    x, y, z = place.shift_mm
    rolls = f"{place.n_feasible} constant rolls work, room {place.margin:.2f}"
    if place.mode != "constant":
        rolls = "a roll that varies along the path works"
    return (
        f"{place.moved_mm:.0f} mm away and turned by {place.turned_deg:.0f}°, to "
        f"({x:.0f}, {y:.0f}, {z:.0f}) mm and {place.turn_deg:.0f}°. Certified: {rolls}."
    )


def _top(found: BasePlacement) -> float:
    return float(found.margins[~found.blocked].max(initial=0.0))
