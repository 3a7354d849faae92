"""``rona verify``: a motion that was planned elsewhere, looked at by the independent verifier."""

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from rona_core.app.overview.motion_report import MotionReport, VerifySettings, report_motion
from rona_core.app.paper_figures.style import FORMATS
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError, storing
from rona_core.session.files import load_session

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
    if wanted.json:
        sys.stdout.write(json.dumps(report.figures(), allow_nan=False) + "\n")
    else:
        _print(report)
    return 0 if report.certified else REFUSED


def _print(report: MotionReport) -> None:
    motion, verdict = report.motion, report.verdict
    table = Table(
        title=f"{len(motion.times_s)} samples, {motion.times_s[-1]:.2f} s, {report.model.name}, "
        f"{verdict.interpolation} between samples",
        title_justify="left",
        pad_edge=False,
    )
    for name in ("check", "value", "allowed", "unit", "sample", "verdict"):
        table.add_column(
            name, justify="right" if name in ("value", "allowed", "sample") else "left"
        )
    for one in verdict.findings:
        check = one.check
        word = "holds" if check.holds else "[red]fails[/red]"
        values = (f"{check.value:.4g}", f"{check.limit:.4g}", check.unit, f"{one.sample:g}", word)
        table.add_row(check.name, *values)
    for one in verdict.not_demanded:
        check = one.check
        word = "not demanded" if check.holds else "[yellow]near; not demanded[/yellow]"
        values = (f"{check.value:.4g}", f"{check.limit:.4g}", check.unit, f"{one.sample:g}", word)
        table.add_row(check.name, *values)
    Console().print(table)
    lines = [one.sentence for one in verdict.refused()]
    lines += [f"hint: {hint}" for hint in verdict.hints]
    lines += [f"around it: {report.around}", *report.remarks]
    lines.append(f"certificate {verdict.certificate.digest}" if report.certified else "refused")
    sys.stdout.write("\n".join(lines) + "\n")
