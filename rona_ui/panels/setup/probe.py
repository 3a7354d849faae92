"""Probe in step 1: choice, expected performance, parameters, delay line, comparison of probes."""

from dataclasses import asdict
from typing import Any

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.steps.acoustics.messages import (
    CalibrateDelayLine,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.acoustics.view import (
    EDITABLE,
    ExpectedPerformance,
    WhatIf,
    edited_probe,
    line_words,
    probe_performances,
    probe_values,
)
from rona_core.app.steps.scan.step import probe_advice
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.devices.probes import BY_FREQUENCY, PROBE_DATA
from rona_core.devices.settings import Excitation, ProbeSettings
from rona_core.session.document import Session
from rona_core.session.specimen import BoneKind
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, SettingsForm, on_click
from rona_ui.panels.widgets.step_panel import JudgementNote
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.fields import read_number

CHOICE = ("name", "excitation", "front_snr_db", "shots", "pitch_mm")
SHOWN_MM = (4.0, 6.0, 8.0, 10.0)  # thicknesses of the small table


class ProbeFields:
    """Fields of one ``SetProbe`` command, and the expected performance."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        """Add probe and excitation, and what each combination promises."""
        self._gui, self._context = gui, context
        self._form = SettingsForm(
            gui,
            context,
            SetProbe,
            lambda session: session.setup.devices.probe,
            *CHOICE,
            make=_message,
            show=lambda held: {**asdict(held), **probe_values(held)},
        )
        self._advice = self._gui.add_html("")
        self._table = self._gui.add_html("")

    def build_details(self) -> None:
        """Add the parameters of a probe, for other probes."""
        form = self._form
        form.add(*EDITABLE, "line_temperature_c")
        self._restore = self._context.send_button(
            self._gui, "Restore probe defaults", "restore", lambda: SetProbe(**form.values(*CHOICE))
        )

    def build_block(self) -> None:
        """Add the calibration of the delay line."""
        self._gui.add_html(
            style.text(
                "The delay of the line determines the position of the outer boundary and "
                "changes with temperature. Calibrate it on a flat steel block."
            )
        )
        self._record = self._context.send_button(
            self._gui, "Record on reference block", "target", StartDelayLineCapture
        )
        self._reset_line = self._context.send_button(
            self._gui, "Reset delay line", "restore", lambda: CalibrateDelayLine(use=False)
        )
        self._line = JudgementNote(self._gui, self._context)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the session: rows, table and state of the line."""
        self._form.render(old, new)
        if not changed(old, new, "session.setup", "session.results", "busy"):
            return
        session, settings = new.session, new.session.setup.devices.probe
        self._table.content = performance_table(probe_performances(settings), settings)
        self._advice.content = advice_note(session)
        words = line_words(session)
        found = judge_part("line", session)
        self._line.show(words or "Nominal delay: not calibrated.", found, busy=new.busy)
        self._reset_line.visible = bool(words)
        for button in (self._record, self._reset_line, self._restore):
            button.disabled = new.busy


def _message(held: ProbeSettings, values: dict[str, Any]) -> SetProbe:
    """Return the command of the rows; another name brings its own details."""
    if values["name"] != held.name:
        values |= {**dict.fromkeys(EDITABLE), "adc_bits": held.adc_bits, "gain_db": held.gain_db}
        return SetProbe(**values)
    return SetProbe(**edited_probe(held, values))


def advice_note(session: Session) -> str:
    """Return which probe the quick look advises as HTML; before one the general rule."""
    advice = probe_advice(session)
    if advice is not None:
        return style.note(advice.sentence, "warn" if advice.another else "good")
    words = ", ".join(
        f"{PROBE_DATA[name].title} for bone of {PROBE_DATA[name].min_thickness_mm:g} to "
        f"{PROBE_DATA[name].fades_mm:g} mm"
        for name in BY_FREQUENCY
    )
    return style.text(
        f"Use {words}; the higher frequency resolves better, hard bone needs the lower. A quick "
        "look with each probe (step 8) says which one suits this bone."
    )


def performance_table(rows: tuple[ExpectedPerformance, ...], chosen: ProbeSettings) -> str:
    """Return the expected performance of each probe and excitation: sigma by thickness, range."""
    cells: list[list[str]] = []
    for row in rows:
        at = dict(zip(row.thickness_mm.tolist(), row.sigma_mm.tolist(), strict=True))
        name = f"{PROBE_DATA[row.probe].title} {row.excitation}"
        if (row.probe, row.excitation) == (chosen.name, chosen.excitation):
            name = f"<b>▶ {name}</b>"
        sigmas = [f"{1e3 * at[mm]:.0f}" if row.reaches(mm) and mm in at else "–" for mm in SHOWN_MM]
        reach = f"{row.least_mm:.0f}–{row.most_mm:.0f}" if row.most_mm > row.least_mm else "none"
        cells.append([name, *sigmas, reach])
    words = (
        '<div class="r-text" style="padding-bottom:0">Lower bound of the thickness σ in µm (noise '
        "only) by bone thickness in mm, and depth range in mm.</div>"
    )
    head = ("Probe", *(f"{mm:.0f}" for mm in SHOWN_MM), "depth")
    return words + style.table(("", *"n" * len(SHOWN_MM), "n"), head, cells)


SWEPT: dict[str, tuple[str, ...]] = {
    "All": tuple(PROBE_DATA),
    **{one.title: (name,) for name, one in PROBE_DATA.items()},
}
EXCITATIONS: dict[str, tuple[Excitation, ...]] = {
    "Both": ("pulse", "chirp"),
    "Chirp": ("chirp",),
    "Pulse": ("pulse",),
}
BONES: dict[str, BoneKind] = {"Normal": "normal", "Sharp diploe": "sharp", "Hard": "hard"}
GOOD, FAIR, POOR = "#e8f5f0", "#fdf1e7", "#f9d9d9"  # behind a cell
FAIR_SHARE, POOR_SHARE = 0.01, 0.1  # of A-scans that would mislead


class ProbeComparisonPanel:
    """Axes of the sweep, a button with progress, and the table."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        gui.add_html(
            style.text(
                "Compares probes and noise levels on virtual plates of layered bone, with "
                "the detection of step 9. Uses no patient data."
            )
        )
        self._advice = gui.add_html("")
        with gui.add_folder("Sweep parameters", expand_by_default=False):
            self._probes = gui.add_dropdown("Probes", tuple(SWEPT))
            self._excitations = gui.add_dropdown("Excitation", tuple(EXCITATIONS))
            self._bone = gui.add_dropdown("Bone", tuple(BONES))
            self._snr = gui.add_text("SNR (dB)", "30, 50", hint="Comma-separated list")
            self._thickness = gui.add_text(
                "Thickness (mm)", "3, 5, 8, 11", hint="Comma-separated list"
            )
        self._start = context.send_button(gui, "Run sweep", "player-play", self.message)
        self._cancel = gui.add_button("Cancel", icon="player-stop", visible=False)
        self._html = gui.add_html("")
        on_click(self._cancel, lambda e: context.service("cancel", e, None))

    def message(self) -> StartProbeSweep:
        """Return the sweep that the fields make."""
        return StartProbeSweep(
            probes=SWEPT[self._probes.value],
            excitations=EXCITATIONS[self._excitations.value],
            snr_db=numbers(self._snr.value),
            thickness_mm=numbers(self._thickness.value),
            bone=BONES[self._bone.value],
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow job and result."""
        held = new.session.results.what_if
        mine = new.busy and new.job is not None and new.job.activity == "StartProbeSweep"
        self._start.disabled = new.busy
        self._cancel.visible = mine
        if mine and new.job is not None:
            self._start.label = f"Running: {100 * new.job.progress:.0f} %"
        else:
            self._start.label = "Run sweep again" if held is not None else "Run sweep"
        if changed(old, new, "session"):
            self._advice.content = advice_note(new.session)
        if changed(old, new, "session.results.what_if"):
            self._html.content = "" if held is None else probe_comparison_table(held.value)


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers in a line with commas."""
    return tuple(read_number(part) for part in text.replace(";", ",").split(",") if part.strip())


def probe_comparison_table(found: WhatIf) -> str:
    """Return a row for each probe, excitation and noise, a column for each thickness."""
    depths = sorted(set(found.thickness_mm.tolist()))
    rows: dict[tuple[str, str, float], dict[float, int]] = {}
    for i, (probe, excitation) in enumerate(zip(found.probes, found.excitations, strict=True)):
        key = (probe, excitation, float(found.snr_db[i]))
        rows.setdefault(key, {})[float(found.thickness_mm[i])] = i
    head = "".join(f'<th class="n">{mm:g} mm</th>' for mm in depths)
    body = ""
    for (probe, excitation, snr_db), cells in rows.items():
        title = f"{probe.replace('MHz', ' MHz')}<br>{excitation} {snr_db:g} dB"
        body += (
            f'<tr><td style="white-space:nowrap">{title}</td>'
            + f"{''.join(_cell(found, cells[mm]) for mm in depths)}</tr>"
        )
    words = (
        f"Each cell: detected share of {found.n} A-scans, SD and bias of the thickness in "
        "µm. Colour: share of all A-scans with an undetected wrong inner boundary."
    )
    legend = ((GOOD, "up to 1 %"), (FAIR, "up to 10 %"), (POOR, "more, or under 5 % detected"))
    return (
        f'<table class="r-table"><tr><th>Probe</th>{head}</tr>{body}</table>'
        f"{style.text(words)}{style.key(legend)}"
    )


def _cell(found: WhatIf, i: int) -> str:
    coverage, wrong = float(found.coverage[i]), float(found.unflagged[i] * found.coverage[i])
    poor = wrong > POOR_SHARE or coverage < 0.05
    color = POOR if poor else FAIR if wrong > FAIR_SHARE else GOOD
    figures = "–"
    if found.n_right[i] > 1:
        figures = f"{1e3 * found.sd_mm[i]:.0f} / {1e3 * found.bias_mm[i]:+.0f}"
    return (
        f'<td class="n" style="background:{color}">{100 * coverage:.0f} %'
        f'<br><span class="g">{figures}</span></td>'
    )
