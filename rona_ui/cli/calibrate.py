"""``rona calibrate pivot``: the tip of a pointer from poses that were recorded elsewhere."""

import json
import re
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rona_core.app.steps.pointer.pivot_report import PivotReport, report_pivot
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError

EXPECTED = "a file with poses, or a folder of them"
EXACT = 1e-6  # rotations so near to rigid ones are taken as they are
REFUSED = 3  # exit status where the data determine no tip
COLOURS = {"good": "green", "weak": "yellow", "bad": "red"}


def run(wanted: Any) -> int:
    """Calibrate and show the result as a table or as JSON."""
    paths = [path for given in wanted.files for path in _expanded(given)]
    files = [NamedFile(str(path), read_file(path, EXPECTED)) for path in paths]
    geometry = wanted.geometry
    if geometry is not None:
        geometry = NamedFile(str(geometry), read_file(geometry, "a .rom or .csv file"))
    report = report_pivot(
        files, geometry=geometry, tool=wanted.tool, dof=wanted.dof, method=wanted.method
    )
    if wanted.json:
        sys.stdout.write(json.dumps(report.figures(), allow_nan=False) + "\n")
    else:
        _print(report)
    return REFUSED if report.calibration.tip_marker is None else 0


def _expanded(path: Path) -> list[Path]:
    """Return the file, or the files in a folder, those with numbers in the order of these."""
    if not path.is_dir():
        return [path]
    found = [p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
    if not found:
        raise InvalidInputError(f"there are no files in the folder {path}")
    return sorted(found, key=lambda p: [int(w) if w.isdigit() else w for w in _words(p.name)])


def _words(name: str) -> list[str]:
    return re.split(r"([0-9]+)", name)  # text and numbers by turns, so that like meets like


def _print(report: PivotReport) -> None:
    found, pivot = report.calibration, report.pivot
    n, seen = pivot.track.n_frames, len(pivot.track.times_s)
    source = f"{seen} poses from {pivot.kind}"
    source += f", {n - seen} of {n} frames without a pose" if n > seen else ""
    table = Table(title=f"Pivot: {source}", title_justify="left", pad_edge=False)
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    figures = report.figures()
    rows = (
        ("Tip in the marker frame", _vector(figures["tip_mm"]), "mm"),
        ("Pivot in the tracker frame", _vector(figures["pivot_mm"]), "mm"),
        ("Predicted deviation of the tip", _number(figures["sigma_mm"]), "mm"),
        ("Scatter of the tip, RMS", _number(figures["rmse_mm"]), "mm"),
        ("Poses used", str(found.n_used), ""),
        ("Poses rejected", str(found.n_rejected), ""),
        ("Poses that repeat the one before", str(found.n_repeated), ""),
    )
    for row in rows:
        table.add_row(*row)
    table.add_row("Verdict", Text(found.verdict, COLOURS[found.verdict]), "")
    console = Console()
    console.print(table)
    if pivot.rounding > EXACT:
        words = f"Rotations in the files are off by up to {pivot.rounding:.1g} from rigid ones."
        console.print(words, highlight=False, soft_wrap=True)
    for reason in found.reasons:
        console.print(Text(f"{found.verdict}: {reason}", COLOURS[found.verdict]), soft_wrap=True)


def _vector(values: list[float] | None) -> str:
    return "-" if values is None else "  ".join(f"{v:.3f}" for v in values)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
