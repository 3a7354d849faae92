"""Calibration of steps 2 and 3: motion that was made, residual of each pose, poses left out."""

from typing import Any

import numpy as np

from rona_core.app.steps.pointer.messages import ExcludePoses
from rona_core.app.steps.tool.calibration_view import (
    EXCLUDED,
    MARKS,
    REJECTED,
    USED,
    CalibrationView,
    Step,
    SwingView,
    calibration_view,
)
from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change, on_click
from rona_ui.panels.widgets.graphs import ImageSlider
from rona_ui.presentation.colors import BLUE, GREEN, ORANGE, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed

INK, GREY, LINE = "#1f2933", "#52606d", "#c5cdd5"
SIZE, RADIUS = 196.0, 72.0  # of the disc, px
MOST_DOTS = 300  # of used poses; all others are drawn
WIDE_GAP_DEG = 45.0  # a narrower one is no gap
WIDTH, HEIGHT = 300.0, 96.0  # of the residuals
TOP_SHARE = 0.92  # of the height, for the largest residual


def coverage_svg(swing: SwingView) -> str:
    """Return the directions of the shaft as a disc: tilt outwards, azimuth clockwise.

    Up is away from the tracker, right its +x side. Dots count, crosses were rejected, rings are
    left out by hand; the widest gap is a sector, the pose proposed next an arrow.
    """
    edge = _edge_deg(swing)
    parts = [_gap(swing)]
    for ring in (r for r in swing.rings_deg if 0.0 < r <= edge):
        parts.append(
            f'<circle r="{RADIUS * ring / edge:.1f}" fill="none" stroke="{LINE}"/>'
            f'<text x="3" y="{-RADIUS * ring / edge - 2:.1f}" fill="{GREY}">{ring:.0f}°</text>'
        )
    for x, y, words, anchor in (
        (0.0, -RADIUS - 13.0, "away from the tracker", "middle"),
        (0.0, RADIUS + 17.0, "towards it", "middle"),
        (RADIUS + 5.0, 4.0, "+x", "start"),
        (-RADIUS - 5.0, 4.0, "−x", "end"),
    ):
        parts.append(
            f'<text x="{x:.0f}" y="{y:.0f}" fill="{GREY}" text-anchor="{anchor}">{words}</text>'
        )
    places = _places(swing.tilts_deg, swing.azimuths_deg, edge)
    parts += [_symbols(places, swing, mark) for mark in (USED, REJECTED, EXCLUDED)]
    parts.append(_arrow(swing, edge))
    half = SIZE / 2.0
    return (
        f'<svg viewBox="{-half:.0f} {-half:.0f} {SIZE:.0f} {SIZE:.0f}" width="{SIZE:.0f}" '
        f'height="{SIZE:.0f}" style="display:block;margin:0 auto" font-size="10" role="img" '
        f'aria-label="Directions of the shaft that were covered">{"".join(parts)}</svg>'
    )


def _edge_deg(swing: SwingView) -> float:
    """Return the tilt at the rim: the smallest ring that holds all there is to draw."""
    most = max(float(swing.tilts_deg.max(initial=0.0)), swing.next_tilt_deg or 0.0, 10.0)
    return next((ring for ring in swing.rings_deg if ring >= most), swing.rings_deg[-1])


def _places(tilts_deg: Floats, azimuths_deg: Floats, edge_deg: float) -> Floats:
    """Return places (n, 2) in the picture."""
    reach = RADIUS * np.minimum(tilts_deg / edge_deg, 1.0)
    angle = np.deg2rad(azimuths_deg)
    return np.column_stack((reach * np.sin(angle), -reach * np.cos(angle)))


def _gap(swing: SwingView) -> str:
    if swing.gap_deg < WIDE_GAP_DEG:
        return ""
    if swing.gap_deg >= 359.0:
        return f'<circle r="{RADIUS:.1f}" fill="{css(ORANGE)}" fill-opacity="0.25"/>'
    ends = swing.gap_azimuth_deg + swing.gap_deg * np.array((-0.5, 0.5))
    (x0, y0), (x1, y1) = _places(np.ones(2), ends, 1.0)
    large = int(swing.gap_deg > 180.0)
    return (
        f'<path d="M0,0L{x0:.1f},{y0:.1f}A{RADIUS:.0f},{RADIUS:.0f} 0 {large} 1 {x1:.1f},{y1:.1f}Z"'
        f' fill="{css(ORANGE)}" fill-opacity="0.25" stroke="{css(ORANGE)}" stroke-dasharray="3 3"/>'
    )


def _symbols(places: Floats, swing: SwingView, mark: int) -> str:
    """Return the poses of one kind as one path."""
    chosen = places[swing.marks == mark]
    if mark == USED:
        chosen = chosen[:: 1 + len(chosen) // MOST_DOTS]
        dots = "".join(f"M{x:.1f},{y:.1f}h0" for x, y in chosen)
        return f'<path d="{dots}" stroke="{css(BLUE)}" stroke-width="4" stroke-linecap="round"/>'
    if mark == REJECTED:
        return f'<path d="{_crosses(chosen, 3.5)}" stroke="{css(VERMILLION)}" stroke-width="1.8"/>'
    return f'<path d="{_rings(chosen, 3.5)}" stroke="{GREY}" stroke-width="1.5" fill="none"/>'


def _crosses(places: Floats, r: float) -> str:
    return "".join(
        f"M{x - r:.1f},{y - r:.1f}l{2 * r:g},{2 * r:g}m0,{-2 * r:g}l{-2 * r:g},{2 * r:g}"
        for x, y in places
    )


def _rings(places: Floats, r: float) -> str:
    return "".join(
        f"M{x - r:.1f},{y:.1f}a{r:g},{r:g} 0 1 0 {2 * r:g},0a{r:g},{r:g} 0 1 0 {-2 * r:g},0"
        for x, y in places
    )


def _arrow(swing: SwingView, edge_deg: float) -> str:
    if swing.next_tilt_deg is None or swing.next_azimuth_deg is None:
        return ""
    (tip,) = _places(np.array([swing.next_tilt_deg]), np.array([swing.next_azimuth_deg]), edge_deg)
    along = tip / max(float(np.linalg.norm(tip)), 1e-9)
    aside, base = np.array((-along[1], along[0])), tip - 10.0 * along
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (tip, base + 5.0 * aside, base - 5.0 * aside))
    color = css(GREEN)
    return (
        f'<line x2="{base[0]:.1f}" y2="{base[1]:.1f}" stroke="{color}" stroke-width="2.5"/>'
        f'<polygon points="{head}" fill="{color}" stroke="#fff" stroke-width="0.8"/>'
    )


def residuals_svg(view: CalibrationView) -> str:
    """Return the residuals of all poses side by side, the RMSE as a dashed line.

    Blue bars count, orange-red bars with a cross were rejected, grey dashed ones with a ring are
    left out by hand. Those larger than fits are cut off at the top.
    """
    top = residual_top_mm(view)
    n = len(view.residuals_mm)
    x = np.linspace(0.0, WIDTH, n) if n > 1 else np.array([WIDTH / 2.0])
    y = HEIGHT - HEIGHT * TOP_SHARE * np.minimum(view.residuals_mm / top, 1.0)
    width = min(6.0, max(0.8, 0.6 * WIDTH / n))
    parts = [f'<rect width="{WIDTH:.0f}" height="{HEIGHT:.0f}" fill="#f4f6f8"/>']
    for mark, color, dash in (
        (USED, css(BLUE), ""),
        (REJECTED, css(VERMILLION), ""),
        (EXCLUDED, GREY, ' stroke-dasharray="2 2"'),
    ):
        rows = view.marks == mark
        bars = "".join(
            f"M{a:.1f},{HEIGHT:.0f}V{b:.1f}" for a, b in zip(x[rows], y[rows], strict=True)
        )
        parts.append(f'<path d="{bars}" stroke="{color}" stroke-width="{width:.1f}"{dash}/>')
        ends = np.column_stack((x[rows], np.clip(y[rows], 4.0, HEIGHT - 4.0)))
        if mark == REJECTED:
            parts.append(f'<path d="{_crosses(ends, 3.0)}" stroke="{color}" stroke-width="1.5"/>')
        elif mark == EXCLUDED:
            parts.append(
                f'<path d="{_rings(ends, 3.0)}" stroke="{color}" stroke-width="1.5" fill="#fff"/>'
            )
    level = HEIGHT - HEIGHT * TOP_SHARE * min(view.rmse_mm / top, 1.0)
    parts.append(
        f'<line x2="{WIDTH:.0f}" y1="{level:.1f}" y2="{level:.1f}" stroke="{INK}" '
        'stroke-dasharray="6 4"/>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" '
        f'preserveAspectRatio="none">{"".join(parts)}</svg>'
    )


def residual_top_mm(view: CalibrationView) -> float:
    """Return the residual at the top of the picture: the largest that counts, with some room."""
    used = view.residuals_mm[view.marks == USED]
    return max(1.3 * float(used.max(initial=0.0)), 2.0 * view.rmse_mm, 1e-6)


STEPS: tuple[Step, ...] = ("tool", "pointer")
EMPTY = "Shows the motion and the residuals once this step is calibrated."


class CalibrationPanel:
    """The calibration of step 2 or 3: that of the step which was looked at last."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._words = gui.add_html(style.text(EMPTY))
        self._steps: dict[Step, tuple[Any, CalibrationControls]] = {}
        for step in STEPS:
            folder = gui.add_folder(None, visible=False)
            with folder:
                self._steps[step] = folder, CalibrationControls(gui, context, step)
        self._shown: Step = "tool"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the calibrations and the active step."""
        for step in STEPS:
            if step == new.view.step:
                self._shown = step
        state = new.step(self._shown)
        known = new.session.results.get(self._shown) is not None
        title = style.tag("div", f"Calibration of step {state.number}: {state.title}", "r-title")
        stale = style.note(f"Stale: {state.reason}.", "warn") if state.state == "stale" else ""
        self._words.content = title + (stale if known else style.text(EMPTY))
        for step, (folder, controls) in self._steps.items():
            folder.visible = known and step == self._shown
            controls.render(old, new)


class CalibrationControls:
    """Motion and residuals of a calibration; poses can be excluded or included."""

    def __init__(self, gui: Any, context: PanelContext, step: Step) -> None:
        self._context = context
        self._step: Step = step
        self._view: CalibrationView | None = None
        self._coverage = gui.add_html("")
        self._folder = gui.add_folder(None, visible=False)
        with self._folder:
            self._title = gui.add_html("")
            self._slider = ImageSlider(
                gui, f"r-{step}-poses", "Pose", int(HEIGHT), lambda e: self._show_pose()
            )
            self._pose = gui.add_html("")
            self._count = gui.add_number("Number of poses", 1, min=1, max=5000, step=1)
            self._toggle = gui.add_button("Exclude", icon="circle-minus", color="gray")
            on_click(self._toggle, self._change)
            self._all = context.send_button(
                gui, "Include all poses", "circle-check", lambda: ExcludePoses(step)
            )
        on_change(self._count, lambda e: self._show_pose())

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the calibration; rest while a job runs."""
        self._toggle.disabled = self._all.disabled = new.busy
        parts = (f"session.results.{self._step}", f"session.captures.{self._step}")
        if not changed(old, new, *parts):
            return
        view = self._view = calibration_view(new.session, self._step)
        self._folder.visible = view is not None
        self._coverage.content = "" if view is None else coverage(view)
        if view is None:
            return
        self._title.content = _residuals_title(view)
        last = max(len(view.residuals_mm) - 1, 1)
        marks = tuple((i, str(i)) for i in sorted({0, last // 2, last}))
        pose = min(self._slider.value or 0, last)
        self._slider.show(residuals_svg(view), (0, last), pose, marks)
        self._all.visible = bool(view.excluded)
        self._show_pose()

    def _rows(self) -> range:
        """Return the poses that are chosen."""
        first = self._slider.value
        if self._view is None or first is None:
            return range(0)
        return range(first, min(first + int(self._count.value), len(self._view.residuals_mm)))

    def _show_pose(self) -> None:
        rows, view = self._rows(), self._view
        if view is None or not len(rows):
            return
        mark, residual_mm = int(view.marks[rows[0]]), float(view.residuals_mm[rows[0]])
        self._pose.content = style.text(
            f"Pose {rows[0]}: {residual_mm:.2f} mm from the common tip, {MARKS[mark]}."
        )
        which = f"pose {rows[0]}" if len(rows) == 1 else f"poses {rows[0]} to {rows[-1]}"
        again = set(rows) <= set(view.excluded)
        self._toggle.label = f"Include {which}" if again else f"Exclude {which}"

    def _change(self, event: Any) -> None:
        view = self._view
        rows, before = set(self._rows()), set(() if view is None else view.excluded)
        wanted = before - rows if rows <= before else before | rows
        self._context.send(lambda: ExcludePoses(self._step, tuple(sorted(wanted))), event)


def coverage(view: CalibrationView) -> str:
    """Return the picture of the motion and what to do next in words."""
    swing = view.swing
    if swing is None:
        return ""
    gap = f"Widest direction gap: {swing.gap_deg:.0f}°. "
    after = ""
    if swing.next_sigma_mm is not None:
        after = f" (expected tip error {swing.next_sigma_mm:.3f} mm)"
    if swing.next_tilt_deg is None:
        advice = f"No next pose: {swing.next_words}."
    else:
        advice = f"Next best pose: {swing.next_words}{after}."
    return style.text("Shaft directions by tilt") + coverage_svg(swing) + style.note(gap + advice)


def _residuals_title(view: CalibrationView) -> str:
    n = len(view.residuals_mm)
    text = (
        f"Height: up to {residual_top_mm(view):.2f} mm; dashed: RMSE {view.rmse_mm:.2f} mm "
        f"of {view.n_used} of {n} used. Small residuals alone do not prove a good "
        "calibration. Click a pose to select it."
    )
    entries = (
        (css(BLUE), "●", USED),
        (css(VERMILLION), "×", REJECTED),
        (GREY, "○", EXCLUDED),
    )
    spans = "".join(
        f'<span><b style="color:{color}">{symbol}</b> {MARKS[mark]} '
        f"({int((view.marks == mark).sum())})</span>"
        for color, symbol, mark in entries
    )
    return style.text(text) + f'<div class="r-key">{spans}</div>'
