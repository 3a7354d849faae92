"""``rona calibrate``: a tip from its pivot, or a sensor from hand-eye poses, recorded elsewhere."""

from pathlib import Path
from typing import Any

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
from rona_ui.cli.output import number, print_judged, show, table_of

REFUSED = 3  # exit status where the data determine no tip


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
    show(report, _print, as_json=wanted.json)
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
    show(report, _print_hand_eye, as_json=wanted.json)
    return REFUSED if report.calibration.verdict == "bad" else 0


def _print_hand_eye(report: HandEyeReport) -> None:
    found, figures = report.calibration, report.figures()
    rows: list[tuple[str, str, str]] = []
    for name, key in (("Sensor", "sensor"), ("Marker", "marker")):
        where = _vector(figures[key]["translation_mm"])
        rows.append((f"{name} in {figures[f'{key}_in']}", where, "mm"))
        rows.append(("  its rotation, w x y z", _vector(figures[key]["wxyz"], 6), ""))
    rows += [
        (name, f"{figures[f'{key}_mm']:.3f} / {figures[f'{key}_deg']:.4f}", "mm / °")
        for name, key in (
            ("Predicted deviation of the sensor", "sensor_sigma"),
            ("Residuals, RMS", "rms"),
            ("Residuals of poses left out, RMS", "left_out_rms"),
        )
    ]
    worst = ", ".join(f"{w['pose']} ({w['off_mm']:.2f} mm)" for w in figures["worst"])
    rows += [
        ("Expected error at the marker", f"{found.sigma_mm:.3f}", "mm"),
        ("Poses rejected", str(figures["n_rejected"]), ""),
        ("Worst poses, from 0", worst, ""),
    ]
    following = figures["next_pose"]
    text = (
        f"Next pose: turn the tool by {following['turn_deg']:.0f}° about "
        f"({_vector(following['axis_tip'], 2)}) of its frame, the marker in its place; the error "
        f"would be {following['sigma_mm']:.3f} mm."
    )
    title = f"Hand-eye, {found.setup}: {len(found.used)} pairs of poses"
    print_judged(table_of(title, rows), found, (*report.notes, text))


def layout_of(wanted: Any) -> PoseLayout:
    """Return what the options say of files of poses."""
    return PoseLayout(wanted.columns, wanted.quaternion, wanted.unit, wanted.frame, wanted.tool)


def _print(report: PivotReport) -> None:
    found, pivot, figures = report.calibration, report.pivot, report.figures()
    n, seen = pivot.track.n_frames, len(pivot.track.times_s)
    source = f"{seen} poses from {pivot.poses.kind}"
    source += f", {n - seen} of {n} frames without a pose" if n > seen else ""
    rows = (
        ("Tip in the marker frame", _vector(figures["tip_mm"]), "mm"),
        ("Pivot in the tracker frame", _vector(figures["pivot_mm"]), "mm"),
        ("Predicted deviation of the tip", number(figures["sigma_mm"]), "mm"),
        ("Scatter of the tip, RMS", number(figures["rmse_mm"]), "mm"),
        ("Poses used", str(found.n_used), ""),
        ("Poses rejected", str(found.n_rejected), ""),
        ("Poses that repeat the one before", str(found.n_repeated), ""),
    )
    print_judged(table_of(f"Pivot: {source}", rows), found, pivot.poses.notes)


def _vector(values: list[float] | None, digits: int = 3) -> str:
    return "-" if values is None else "  ".join(f"{v:.{digits}f}" for v in values)
