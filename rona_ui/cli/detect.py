"""``rona detect``: thickness of a plate or bone from radio-frequency lines recorded elsewhere."""

import json
import sys
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from rona_core.app.steps.scan.rf_report import RfReport, report_rf
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile

EXPECTED = "an HDF5, .mat or .npz file"
MAX_BYTES = 384 * 1024**2  # more than the most values that are read, as float64
NOTHING = 3  # exit status where no line shows a back wall
REASONS = (
    "ok",
    "no front echo",
    "no back wall",
    "unsure: unlike the others, or at another lag",
    "echo cut off by begin or end of the record: record longer",
)


def run(wanted: Any) -> int:
    """Detect and show the result as a table or as JSON."""
    file = NamedFile(str(wanted.file), read_file(wanted.file, EXPECTED, MAX_BYTES))
    columns = (TextColumn("{task.description}"), BarColumn(40), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("detecting", total=1.0)

        def progress(share: float) -> None:
            bar.update(task, completed=share)

        report = report_rf(file, wanted.speed, probe=wanted.probe, progress=progress)
    if wanted.json:
        sys.stdout.write(json.dumps(report.figures(), allow_nan=False) + "\n")
    else:
        _print(report)
    return 0 if report.detection.ok.any() else NOTHING


def _print(report: RfReport) -> None:
    found, summary, read = report.detection, report.summary, report.recorded
    speed = found.sound_speed_mm_per_us * 1e3
    table = Table(
        title=f"{len(read)} lines of {read.rf.shape[1]} samples at {read.sampling_mhz:g} MHz, "
        f"{speed:g} m/s",
        title_justify="left",
        pad_edge=False,
    )
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    about = "about a plane" if read.positions_mm is not None else "about the median"
    predicted = float(np.median(found.sigma_mm[found.ok])) if found.ok.any() else None
    table.add_row("Mean thickness", _number(summary.mean_mm), "mm")
    table.add_row(f"Robust deviation {about}", _number(summary.robust_sd_mm, 4), "mm")
    table.add_row("Predicted standard deviation", _number(predicted, 4), "mm")
    table.add_row("Failures", f"{100 * summary.failure_fraction:.1f}", "%")
    table.add_row("Flagged", f"{100 * summary.flagged_fraction:.1f}", "%")
    for code, reason in enumerate(REASONS[1:], 1):
        if (found.flag == code).any():
            table.add_row(f"  {reason}", str(int((found.flag == code).sum())), "scans")
    table.add_row("Clipped", str(int(found.clipped.sum())), "scans")
    table.add_row("Centre and width of the band", _band(report), "MHz")
    turned = "inverted" if found.back_inverted else "upright"
    table.add_row("Back wall over front", f"{found.back_level:.2f}, {turned}", "")
    Console().print(table)


def _band(report: RfReport) -> str:
    return f"{report.detection.centre_mhz:.2f}, {report.detection.width_mhz:.2f}"


def _number(value: float | None, decimals: int = 3) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
