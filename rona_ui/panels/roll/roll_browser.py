"""Roll browser: roll image, which is also the slider that selects a roll; margins; ranking."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.steps.roll.messages import ChooseRoll
from rona_core.app.steps.roll.view import (
    REASON_WORDS,
    PathMargins,
    Quantity,
    RankedWay,
    RollStrip,
    joint_curves,
    path_margins,
    place_of_roll,
    point_at,
    ranked_ways,
    roll_strip,
    shown_roll,
    shows_chosen,
    shows_varying,
)
from rona_core.app.steps.setup.clearance import PairClearance
from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change
from rona_ui.panels.widgets.graphs import ImageSlider, png_url
from rona_ui.presentation.colors import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    YELLOW,
    Rgb,
    css,
    viridis,
    viridis_css,
)
from rona_ui.presentation.snapshot import MARGIN_SCALE_MAX, Snapshot, changed, shown_clearances
from rona_ui.viewer.bindings import escape

REASON_COLORS: dict[str, Rgb] = {  # of the verdicts in the strip
    "none": GREEN,
    "limit": VERMILLION,
    "reach": PURPLE,
    "singularity": ORANGE,
    "jump": BLUE,
    "blocked": SKY,
    "roll rate": SKY,
    "no way": YELLOW,
}
STRIP, GAP, MAP = 80.0, 20.0, 1000.0  # heights in the picture
WIDE = 10.0  # of a roll in the picture


def roll_picture(strip: RollStrip) -> str:
    """Return the picture as SVG; the middle of its first and last roll are its edges."""
    n, top = len(strip.rolls_deg), STRIP + GAP
    width, height = WIDE * (n - 1), top + MAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        'preserveAspectRatio="none" shape-rendering="crispEdges">',
        f'<rect width="{width:g}" height="{height:g}" fill="#fff"/>',
        *(
            f'<rect x="{WIDE * (i - 0.5):g}" width="{WIDE:g}" height="{STRIP:g}" '
            f'fill="{css(REASON_COLORS[reason])}"/>'
            for i, reason in enumerate(strip.reasons)
        ),
        f'<image x="{-0.5 * WIDE:g}" y="{top:g}" width="{WIDE * n:g}" height="{MAP:g}" '
        f'preserveAspectRatio="none" style="image-rendering:pixelated" '
        f'href="{png_url(roll_image(strip))}"/>',
        *(
            f'<rect x="{WIDE * (i - 0.4):g}" y="{top + MAP * min(at, 0.985):g}" '
            f'width="{0.8 * WIDE:g}" height="{0.015 * MAP:g}" fill="#fff"/>'
            for i, at in enumerate(strip.fails_at.tolist())
            if not strip.feasible[i]
        ),
    ]
    for line in curve_lines(strip):
        places = " ".join(f"{x:.1f},{y:.1f}" for x, y in line.tolist())
        for color, px in (("#fff", 5), ("#1f2933", 2)):
            parts.append(
                f'<polyline points="{places}" fill="none" stroke="{color}" stroke-width="{px}" '
                'vector-effect="non-scaling-stroke"/>'
            )
    return "".join((*parts, "</svg>"))


def curve_lines(strip: RollStrip) -> list[Floats]:
    """Return the chosen roll as lines (n, 2) in the picture, parted where it leaves at one edge."""
    curve, rolls = strip.curve_deg, strip.rolls_deg
    if not len(curve):
        return []
    step = float(rolls[1] - rolls[0])
    around = bool(abs(step * len(rolls) - 360.0) < 1e-6)
    columns = (curve - rolls[0]) / step
    if around:
        columns = np.mod(columns, len(rolls))
    y = STRIP + GAP + MAP * np.linspace(0.0, 1.0, len(curve))
    breaks = np.flatnonzero(np.abs(np.diff(columns)) > 0.5 * len(rolls)) + 1
    points = np.column_stack((WIDE * columns, y))
    return [part for part in np.split(points, breaks) if len(part) > 1]


def legend(strip: RollStrip) -> str:
    """Return what the colours of strip and map mean."""
    counts = Counter(strip.reasons)
    entries = [
        (css(color), "", f"{counts[reason]} × {REASON_WORDS[reason]}")
        for reason, color in REASON_COLORS.items()
        if counts[reason]
    ]
    map_key = [
        (
            viridis_css(),
            "width:44px;",
            f"margin, 0 to {end_words(float(strip.node_room.max(initial=0.0)), 'room')}",
        ),
        (css(VERMILLION), "", "no margin"),
        ("#fff;border:1px solid #52606d", "height:4px;", "first failure"),
    ]
    if len(strip.curve_deg):
        map_key.append(("#1f2933", "width:3px;", "selected roll"))
    spans = "".join(
        f'<span><i style="{size}background:{color}"></i>{escape(words)}</span>'
        for color, size, words in (*entries, *map_key)
    )
    return f'<div class="r-key">{spans}</div>'


def end_words(largest: float, quantity: Quantity) -> str:
    """Return the value at the end of the colours of a quantity; what is larger has that colour."""
    top = MARGIN_SCALE_MAX[quantity]
    return f"{'≥ ' if largest > top else ''}{top:.{DECIMALS[quantity]}f}"


def roll_image(strip: RollStrip) -> NDArray[np.uint8]:
    """Return the colours of the map, (places, rolls, 3): path down, rolls across."""
    image = viridis(np.clip(strip.node_room / MARGIN_SCALE_MAX["room"], 0.0, 1.0))
    image[strip.node_room < 0.0] = VERMILLION
    return image


HEIGHT_PX = 190
NOTHING = "The roll map appears after step 7."
WORDS = (
    "Across: roll angle. Down: position along the path. Click or drag to select a roll; a "
    "feasible one is planned and verified."
)
LISTED = 12  # rolls in the table of the ranking; the choice has more


class RollsPanel:
    """Click in the picture: the roll is shown; one that works is planned and verified at once."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._words = gui.add_html(style.text(NOTHING))
        self._slider = ImageSlider(gui, "r-rolls", "Roll", HEIGHT_PX, self._chosen)
        self._remark = gui.add_html("")
        self._back = context.view_button(
            gui, "Show selected roll", "arrow-back-up", shown_roll=None, place=None
        )
        hint = "Where along the path the robot is shown"
        self._place = gui.add_slider(
            "Path position (%)", 0.0, 100.0, 0.5, 50.0, visible=False, hint=hint
        )
        self._legend = gui.add_html("")
        self._margins = MarginControls(gui, context)
        self._ranking = RollRanking(gui, context)
        self._works: tuple[bool, ...] = ()
        on_change(
            self._place,
            lambda e: context.set_view(place=e.target.value / 100.0, cursor=None, playing=False),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow search and shown roll."""
        roll, view = new.session.results.roll, new.view
        self._margins.render(old, new)
        self._ranking.render(old, new)
        if changed(old, new, "session.results.roll"):
            self._build(new)
        elif not changed(old, new, "view.shown_roll", "view.place", "steps"):
            return
        self._back.visible = roll is not None and not shows_chosen(roll.value, view.shown_roll)
        self._back.disabled = roll is None or roll.value.search.mode == "none"
        self._remark.content = remark(new)
        index = column_shown(new)
        if index is not None:
            self._slider.value = index
            place = place_of_roll(new.session, view.shown_roll, view.place)
            self._place.value = round(200.0 * place) / 2.0

    def _build(self, new: Snapshot) -> None:
        strip = roll_strip(new.session)
        self._place.visible = strip is not None
        if strip is None or len(strip.rolls_deg) < 2:
            self._words.content = style.text(NOTHING)
            self._legend.content = ""
            self._slider.clear()
            return
        self._words.content = style.text(WORDS)
        self._works = tuple(bool(works) for works in strip.feasible)
        self._legend.content = legend(strip)
        last = len(strip.rolls_deg) - 1
        marked = np.unique(np.linspace(0, last, 5).round().astype(int)).tolist()
        marks = tuple((i, f"{strip.rolls_deg[i]:.0f}°") for i in marked)
        self._slider.show(roll_picture(strip), (0, last), max(strip.chosen, 0), marks)

    def _chosen(self, event: Any) -> None:
        index = int(event.target.value)
        self._context.set_view(shown_roll=index, place=None, cursor=None, playing=False)
        if 0 <= index < len(self._works) and self._works[index]:
            self._context.send_debounced("roll", lambda: ChooseRoll(index), event)


def column_shown(snapshot: Snapshot) -> int | None:
    """Return the slider position: the shown roll, or a varying roll at its path position."""
    view, searched = snapshot.view, snapshot.session.results.roll
    index = shown_roll(snapshot.session, view.shown_roll)
    if index is None or searched is None or not shows_varying(searched.value, view.shown_roll):
        return index
    plan = searched.value
    place = place_of_roll(snapshot.session, view.shown_roll, view.place)
    roll_deg = np.rad2deg(plan.search.rolls_rad[point_at(plan, place)])
    apart = [abs((v.roll_deg - roll_deg + 180.0) % 360.0 - 180.0) for v in plan.search.verdicts]
    return int(np.argmin(apart))


def remark(snapshot: Snapshot) -> str:
    """Return the verdict on the shown roll as HTML."""
    curves = joint_curves(snapshot.session, snapshot.view.shown_roll)
    if curves is None:
        return ""
    words = style.sentence(curves.sentence)
    if not curves.feasible and curves.worst_joint:
        words += f". Red in the scene: this place, and the links after joint {curves.worst_joint}"
    if snapshot.step("roll").state == "stale":
        return style.note(f"{words}. Stale: plan again.", "warn")
    return style.note(words, "good" if curves.feasible else "warn")


class RollRanking:
    """A closed folder: the table of the best rolls, and a choice that plans with one of them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._ways: dict[str, RankedWay] = {}  # by what the choice says of them
        self._folder = gui.add_folder("Ranking", expand_by_default=False, visible=False)
        with self._folder:
            hint = "Plans and verifies this configuration"
            self._choice = gui.add_dropdown("Use", ("–",), hint=hint)
            self._table = gui.add_html("")
        on_change(self._choice, self._take)

    def _take(self, event: Any) -> None:
        way = self._ways.get(self._choice.value)
        if way is not None:
            self._context.set_view(shown_roll=None, place=None, cursor=None, playing=False)
            self._context.send(lambda: ChooseRoll(way.index, way.branch), event)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the search."""
        self._choice.disabled = new.busy
        if not changed(old, new, "session.results.roll"):
            return
        ways = ranked_ways(new.session)
        self._ways = {
            f"{number}: {way.roll_deg:.0f}°, margin {way.margin:.2f}": way
            for number, way in enumerate(ways, start=1)
        }
        self._folder.visible = bool(ways)
        self._choice.options = ("–", *self._ways)
        self._choice.value = next((name for name, way in self._ways.items() if way.chosen), "–")
        self._table.content = ranking_table(ways)


def ranking_table(ways: tuple[RankedWay, ...]) -> str:
    """Return the best rolls and the chosen one."""
    if not ways:
        return ""
    rows: list[tuple[str, ...]] = []
    for number, way in enumerate(ways, start=1):
        if number <= LISTED or way.chosen:
            place = f"{number} ✔" if way.chosen else f"{number}"
            margin = f"{way.margin:.2f}"
            rows.append((place, f"{way.roll_deg:.0f}°", escape(way.label), margin))
    return style.table(("n", "n", "", "n"), ("#", "Roll", "Arm", "Margin"), rows) + style.text(
        "Margin: smallest distance from limits, singularities and jumps along the path."
    )


QUANTITIES: dict[str, Quantity] = {
    "Smallest margin": "room",
    "Joint limits": "limits",
    "Singularities": "singularity",
    "Collisions": "clearance",
}
CLEARANCE = FIGURES["min_clearance_mm"]
JOINT_LIMITS = FIGURES["min_joint_margin_deg"]
UNITS: dict[Quantity, str] = {
    "room": "Margin to limits, singularities, jumps and reach (1 is comfortable)",
    "limits": f"{JOINT_LIMITS.title} (°)",
    "singularity": "Margin to the nearest singularity (1 is comfortable)",
    "clearance": "Clearance of robot, tool and obstacles (mm)",
}
DECIMALS: dict[Quantity, int] = {"room": 1, "limits": 0, "singularity": 1, "clearance": 0}


class MarginControls:
    """Dropdown, colour bar, and the nearest pair."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._choice = gui.add_dropdown("Path colour", tuple(QUANTITIES), visible=False)
        self._bar = gui.add_html("")
        self._near = gui.add_html("")
        on_change(
            self._choice,
            lambda e: context.set_view(margin=QUANTITIES[self._choice.value]),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow search, shown roll, quantity and the robot as it is drawn."""
        has_view = new.session.results.roll is not None
        self._choice.visible = has_view
        if old is not None and changed(old, new, "session.id"):
            self._choice.value = next(w for w, q in QUANTITIES.items() if q == new.view.margin)
        view = ("view.shown_roll", "view.margin", "view.step")
        if changed(old, new, "session.results", "session.setup", *view):
            # in other steps it is not looked at: not worth the time
            found = None
            if new.view.step in ("roll", "scan"):
                found = path_margins(new.session, new.view.shown_roll)
            self._bar.content = (
                "" if found is None else margin_words(found) + bar(found, new.view.margin)
            )
        self._near.content = near_words(shown_clearances(new)) if has_view else ""


def bar(found: PathMargins, quantity: Quantity) -> str:
    """Return the colour bar of a quantity, and the least value along the path."""
    top, decimals = MARGIN_SCALE_MAX[quantity], DECIMALS[quantity]
    values, fails = found.values(quantity), found.fails(quantity)
    end = end_words(float(values.max(initial=0.0)), quantity)
    ticks = f"<span>0</span><span>{0.5 * top:.{decimals}f}</span>"
    least = float(values.min())
    words = f"Minimum along the path: {least:.{max(decimals, 1)}f}."
    if fails.any():
        part = 100.0 * float(fails.mean())
        words += f" Red on {max(part, 1.0):.0f} % of the path: not allowed."
    closest = PairClearance(*found.closest, found.closest_mm, found.needed_mm)
    if quantity == "clearance":
        share = 100.0 * found.closest_at / max(len(values) - 1, 1)
        words += f" Closest: {closest.sentence} (at {share:.0f} %)."
    return (
        f'<div class="r-text" style="padding-bottom:2px">{escape(UNITS[quantity])}</div>'
        '<div style="display:flex;margin:0 12px;gap:4px">'
        f'<div class="r-bar" style="margin:2px 0 1px;width:14px;background:{css(VERMILLION)}">'
        f'</div><div class="r-bar" style="margin:2px 0 1px;flex:1;background:{viridis_css()}">'
        f'</div></div><div class="r-ticks" style="margin-left:30px">{ticks}'
        f"<span>{end}</span></div>{style.text(words)}"
    )


def margin_words(found: PathMargins) -> str:
    """Return the least margins of the shown roll along the path, before a motion is planned."""
    limits, clearance = found.values("limits").min(), found.values("clearance").min()
    return style.text(
        f"Least along the path: {JOINT_LIMITS.words(float(limits))} from joint limits, margin to "
        f"singularities {found.values('singularity').min():.1f}, clearance "
        f"{CLEARANCE.words(float(clearance))}."
    )


def near_words(pairs: tuple[PairClearance, ...]) -> str:
    """Return what comes too close with the robot as it is drawn, else the nearest pair."""
    hits = [pair for pair in pairs if pair.too_close]
    if hits:
        more = f" And {len(hits) - 1} more." if len(hits) > 1 else ""
        return style.note(f"Too close, red in the scene: {hits[0].sentence}.{more}", "warn")
    return style.text(f"Nearest now: {pairs[0].sentence}.") if pairs else ""
