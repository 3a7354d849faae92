"""Probe comparison: a sweep over virtual plates, as a table coloured by failures."""

from typing import Any

from rona_core.app.steps.acoustics.messages import StartProbeSweep
from rona_core.app.steps.acoustics.view import WhatIf
from rona_core.devices.settings import Excitation, ProbeName
from rona_core.session.specimen import BoneKind
from rona_ui.panels.setup.probe import advice_note
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.fields import read_number

PROBES: dict[str, tuple[ProbeName, ...]] = {
    "Both": ("2.25MHz", "1MHz"),
    "2.25 MHz": ("2.25MHz",),
    "1 MHz": ("1MHz",),
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
            self._probes = gui.add_dropdown("Probes", tuple(PROBES))
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
            probes=PROBES[self._probes.value],
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
