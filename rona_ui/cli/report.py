"""``rona report``: a session as one HTML page."""

import sys
from pathlib import Path
from typing import Any

from rona_core.app.report.report import workbench_report
from rona_core.compose import open_session
from rona_core.errors import storing


def run(wanted: Any) -> int:
    """Write the page beside the session file, or where it is wanted, and say where it is."""
    bench = open_session(wanted.file)
    try:
        page = workbench_report(bench).encode("utf-8")
    finally:
        bench.close()
    out: Path = wanted.out or wanted.file.with_suffix(".html")
    with storing(out):
        out.write_bytes(page)
    sys.stdout.write(f"{out}  {len(page) / 1024:.0f} kB\n")
    return 0
