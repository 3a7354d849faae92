"""``rona verify``: a motion that was planned elsewhere, looked at by the independent verifier."""

import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from rona_core.app.overview.motion_report import MotionReport, VerifySettings, report_motion
from rona_core.app.paper_figures.style import FORMATS
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError, storing
from rona_core.session.files import load_session
from rona_ui.cli.output import show, table_of

REFUSED = 3  # exit status where the verifier refuses the motion
ITSELF = "self"


def run(wanted: Any) -> int:
    """Verify, and show the verdict as text or as JSON."""
    picture: Path | None = wanted.picture
    form = "" if picture is None else picture.suffix.removeprefix(".").lower()
    if picture is not None and form not in FORMATS:
        raise InvalidInputError(f"--picture must end with .{' or .'.join(FORMATS)}, not {picture}")
    session = None if wanted.obstacles == ITSELF else load_session(Path(wanted.obstacles))
    settings = VerifySettings(
        interpolation=wanted.interpolation,
        tool=wanted.tool,
        tool_speed_mm_per_s=wanted.tool_speed,
        demand_singular=wanted.demand == "singular",
        topic=wanted.topic,
    )
    file = NamedFile(str(wanted.file), read_file(wanted.file, "a motion"))
    report = report_motion(file, wanted.robot, settings, session)
    if picture is not None:
        from rona_core.app.paper_figures.motion import motion_picture

        with storing(picture):
            picture.write_bytes(motion_picture(report, "png" if form == "png" else "svg"))
    show(report, _print, as_json=wanted.json)
    return 0 if report.certified else REFUSED


def _print(report: MotionReport) -> None:
    motion, verdict = report.motion, report.verdict
    rows = [
        (
            one.check.name,
            f"{one.check.value:.4g}",
            f"{one.check.limit:.4g}",
            one.check.unit,
            f"{one.sample:g}",
            holds if one.check.holds else fails,
        )
        for found, holds, fails in (
            (verdict.findings, "holds", "[red]fails[/red]"),
            (verdict.not_demanded, "not demanded", "[yellow]near; not demanded[/yellow]"),
        )
        for one in found
    ]
    title = f"{len(motion.times_s)} samples, {motion.times_s[-1]:.2f} s, {report.model.name}, "
    title += f"{verdict.interpolation} between samples"
    columns = ("check", "value", "allowed", "unit", "sample", "verdict")
    Console().print(table_of(title, rows, columns, ("value", "allowed", "sample")))
    lines = [one.sentence for one in verdict.refused()]
    lines += [f"hint: {hint}" for hint in verdict.hints]
    lines += [f"around it: {report.around}", *report.remarks]
    lines.append(f"certificate {verdict.certificate.digest}" if report.certified else "refused")
    sys.stdout.write("\n".join(lines) + "\n")
