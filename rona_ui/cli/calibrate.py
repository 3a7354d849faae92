"""``rona calibrate``: a tip from its pivot, or a sensor from hand-eye poses, recorded elsewhere."""

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rona_core.app.steps.pointer.pivot_report import PivotReport, report_pivot
from rona_core.app.steps.tool.hand_eye_report import (
    HandEyeOptions,
    HandEyeReport,
    both_layouts,
    report_hand_eye,
)
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.recorded_poses import pose_files
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError, storing

REFUSED = 3  # exit status where the data determine no tip
COLOURS = {"good": "green", "weak": "yellow", "bad": "red"}


def run(wanted: Any) -> int:
    """Calibrate and show the result as a table or as JSON."""
    return _hand_eye(wanted) if wanted.what == "hand-eye" else _pivot(wanted)


def _pivot(wanted: Any) -> int:
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


def _hand_eye(wanted: Any) -> int:
    picture: Path | None = wanted.picture
    form = None if picture is None else picture.suffix[1:].lower()
    if form not in (None, "svg", "png"):
        raise InvalidInputError(f"a picture is .svg or .png, not {picture}")
    options = HandEyeOptions(
        wanted.setup, wanted.noise, wanted.inverse, wanted.robot, wanted.sensor
    )
    unit, wanted.unit = wanted.unit, None
    report = report_hand_eye(
        [wanted.robot_file],
        None if wanted.sensor_file is None else [wanted.sensor_file],
        options,
        layouts=both_layouts(layout_of(wanted), unit),
    )
    if picture is not None and form is not None:
        from rona_core.app.paper_figures.hand_eye import hand_eye_picture

        with storing(picture):
            picture.write_bytes(hand_eye_picture(report, form))
    if wanted.json:
        sys.stdout.write(json.dumps(report.figures(), allow_nan=False) + "\n")
    else:
        _print_hand_eye(report)
    return REFUSED if report.calibration.verdict == "bad" else 0


def _print_hand_eye(report: HandEyeReport) -> None:
    found, figures = report.calibration, report.figures()
    n = len(found.used)
    title = f"Hand-eye, {found.setup}: {n} pairs of poses"
    table = Table(title=title, title_justify="left", pad_edge=False)
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for name, key in (("Sensor", "sensor"), ("Marker", "marker")):
        where = figures[f"{key}_in"]
        table.add_row(f"{name} in {where}", _vector(figures[key]["translation_mm"]), "mm")
        table.add_row("  its rotation, w x y z", _vector(figures[key]["wxyz"], 6), "")
    rows = (
        ("Predicted deviation of the sensor", "sensor_sigma_mm", "sensor_sigma_deg"),
        ("Residuals, RMS", "rms_mm", "rms_deg"),
        ("Residuals of poses left out, RMS", "left_out_rms_mm", "left_out_rms_deg"),
    )
    for name, mm, degrees in rows:
        table.add_row(name, f"{figures[mm]:.3f} / {figures[degrees]:.4f}", "mm / °")
    table.add_row("Expected error at the marker", f"{found.sigma_mm:.3f}", "mm")
    table.add_row("Poses rejected", str(figures["n_rejected"]), "")
    worst = ", ".join(f"{w['pose']} ({w['off_mm']:.2f} mm)" for w in figures["worst"])
    table.add_row("Worst poses, from 0", worst, "")
    table.add_row("Verdict", Text(found.verdict, COLOURS[found.verdict]), "")
    console = Console()
    console.print(table)
    following = figures["next_pose"]
    axis = _vector(following["axis_tip"], 2)
    text = f"Next pose: turn the tool by {following['turn_deg']:.0f}° about ({axis}) of its frame, "
    text += f"the marker in its place; the error would be {following['sigma_mm']:.3f} mm."
    for note in (*report.notes, text):
        console.print(note, highlight=False, soft_wrap=True)
    for reason in found.reasons:
        console.print(Text(f"{found.verdict}: {reason}", COLOURS[found.verdict]), soft_wrap=True)


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


def _vector(values: list[float] | None, digits: int = 3) -> str:
    return "-" if values is None else "  ".join(f"{v:.{digits}f}" for v in values)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
