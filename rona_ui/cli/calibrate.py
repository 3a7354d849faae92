"""``rona calibrate pivot``: the tip of a pointer from poses that were recorded elsewhere."""

import json
import sys
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rona_core.app.steps.pointer.pivot_report import PivotReport, report_pivot
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.recorded_poses import pose_files
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile

REFUSED = 3  # exit status where the data determine no tip
COLOURS = {"good": "green", "weak": "yellow", "bad": "red"}


def run(wanted: Any) -> int:
    """Calibrate and show the result as a table or as JSON."""
    files = pose_files(wanted.files)
    geometry = wanted.geometry
    if geometry is not None:
        geometry = NamedFile(str(geometry), read_file(geometry, "a .rom or .csv file"))
    report = report_pivot(
        files, layout_of(wanted), geometry=geometry, dof=wanted.dof, method=wanted.method
    )
    if wanted.json:
        sys.stdout.write(json.dumps(report.figures(), allow_nan=False) + "\n")
    else:
        _print(report)
    return REFUSED if report.calibration.tip_marker is None else 0


def layout_of(wanted: Any) -> PoseLayout:
    """Return what the options say of files of poses."""
    return PoseLayout(wanted.columns, wanted.quaternion, wanted.unit, wanted.frame, wanted.tool)


def _print(report: PivotReport) -> None:
    found, pivot = report.calibration, report.pivot
    n, seen = pivot.track.n_frames, len(pivot.track.times_s)
    source = f"{seen} poses from {pivot.poses.kind}"
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
    for note in pivot.poses.notes:
        console.print(note, highlight=False, soft_wrap=True)
    for reason in found.reasons:
        console.print(Text(f"{found.verdict}: {reason}", COLOURS[found.verdict]), soft_wrap=True)


def _vector(values: list[float] | None) -> str:
    return "-" if values is None else "  ".join(f"{v:.3f}" for v in values)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
