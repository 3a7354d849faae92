"""``rona detect``: thickness of a plate or bone from radio-frequency lines recorded elsewhere."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from rona_core.app.steps.scan.rf_report import RfReport, report_rf
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_ui.cli.output import number, show, table_of

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
    show(report, _print, as_json=wanted.json)
    return 0 if report.detection.ok.any() else NOTHING


def _print(report: RfReport) -> None:
    found, summary, read = report.detection, report.summary, report.recorded
    about = "about a plane" if read.positions_mm is not None else "about the median"
    predicted = float(np.median(found.sigma_mm[found.ok])) if found.ok.any() else None
    counts = [(f"  {reason}", int((found.flag == k).sum())) for k, reason in enumerate(REASONS)]
    turned = "inverted" if found.back_inverted else "upright"
    rows = [
        ("Mean thickness", number(summary.mean_mm), "mm"),
        (f"Robust deviation {about}", number(summary.robust_sd_mm, 4), "mm"),
        ("Predicted standard deviation", number(predicted, 4), "mm"),
        ("Failures", f"{100 * summary.failure_fraction:.1f}", "%"),
        ("Flagged", f"{100 * summary.flagged_fraction:.1f}", "%"),
        *((reason, str(count), "scans") for reason, count in counts[1:] if count),
        ("Clipped", str(int(found.clipped.sum())), "scans"),
        ("Centre and width of the band", f"{found.centre_mhz:.2f}, {found.width_mhz:.2f}", "MHz"),
        ("Back wall over front", f"{found.back_level:.2f}, {turned}", ""),
    ]
    title = f"{len(read)} lines of {read.rf.shape[1]} samples at {read.sampling_mhz:g} MHz, "
    title += f"{found.sound_speed_mm_per_us * 1e3:g} m/s"
    Console().print(table_of(title, rows))
