"""``rona compare``: maps of a session beside a reference."""

import json
import sys
from dataclasses import asdict
from typing import Any

from rona_core.app.steps.maps.comparison import compare_maps
from rona_core.devices.files.size_limits import read_file
from rona_core.session.files import load_session

HEADS = ("", "cells", "covered", "bias", "RMS", "spread", "95 %", "stated")


def run(wanted: Any) -> int:
    """Print the figures of each map, in mm."""
    data = read_file(wanted.reference, "a reference (mesh, CT or session)")
    session = load_session(wanted.file)
    how, threshold = wanted.register, wanted.threshold
    found = compare_maps(session, data, wanted.reference.name, how, threshold=threshold)
    fit = None if found.place is None else found.place.surface
    if wanted.json:
        rows = [asdict(row) for row in found.figures]
        facts = {"reference": found.name, "figures": rows, "verdict": fit and fit.verdict}
        sys.stdout.write(json.dumps(facts, allow_nan=False) + "\n")
        return 0
    lines: list[tuple[str, ...]] = [HEADS]
    for row in found.figures:
        sizes = (row.bias_mm, row.rms_mm, row.spread_mm, row.p95_mm, row.stated_mm)
        numbers = ["" if size is None else f"{size:z.3f}" for size in sizes]
        title = row.name.replace("_", " ")
        lines.append((title, str(row.cells), f"{row.coverage:.0%}", *numbers))
    for first, *others in lines:
        sys.stdout.write(f"{first:<18}" + "".join(f"{word:>9}" for word in others) + "\n")
    if fit is not None:
        sys.stdout.write(f"registered by surface: {fit.verdict}, RMS {fit.rms_mm:.3f} mm\n")
        sys.stdout.writelines(f"  {reason}\n" for reason in fit.reasons)
    return 0
