"""``rona demo``: the complete procedure without a browser, and its figures against ground truth."""

import json
import math
import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.procedure import OFFERED, PROCEDURE, stages
from rona_core.compose import DemoSkull, run_demo
from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.world_settings import WorldProfile, WorldSettings
from rona_core.errors import InvalidInputError
from rona_core.session.document import Session
from rona_core.session.files import save_session

INCOMPLETE = 3  # exit status where there are no maps or no bed
COLOURS = {"pass": "green", "review": "yellow", "fail": "red"}


def run(wanted: Any) -> int:
    """Carry out the procedure, show how far it is, and end with the figures."""
    _check(wanted)
    with _bars() as show:
        session, figures = run_demo(
            wanted.seed,
            DemoSkull(
                None if wanted.specimen == "simulated" else wanted.specimen,
                wanted.inner,
                wanted.threshold,
                None if wanted.center is None else tuple(wanted.center),
                wanted.radius,
                wanted.label,
            ),
            robot=wanted.robot,
            world=WorldSettings(wanted.world),
            probe=wanted.probe,
            among=stages(PROCEDURE[-1].name, skip=wanted.skip),
            progress=show,
        )
    if wanted.json:
        sys.stdout.write(json.dumps(figures, allow_nan=False) + "\n")
    else:
        _print_figures(figures, session)
    sys.stdout.flush()  # the figures are printed even if the file cannot be written
    if wanted.out is not None:
        save_session(session, wanted.out)
        if not wanted.json:
            sys.stdout.write(f"saved in {wanted.out}\n")
    return 0 if figures.get("completed") else INCOMPLETE


def _check(wanted: Any) -> None:
    """Refuse what would fail only at the end of the procedure, or mean nothing in it."""
    if wanted.specimen == "simulated":
        for name in ("inner", "threshold", "label"):
            if getattr(wanted, name) is not None:
                raise InvalidInputError(f"--{name} belongs to a --specimen from a file: name one")
    if wanted.world not in get_args(WorldProfile):
        known = ", ".join(get_args(WorldProfile))
        raise InvalidInputError(f"--world must be one of {known}, not {wanted.world}")
    if wanted.probe not in PROBE_DATA:
        known = ", ".join(PROBE_DATA)
        raise InvalidInputError(f"--probe must be one of {known}, not {wanted.probe}")
    for name in wanted.skip:
        if name not in OFFERED:
            raise InvalidInputError(f"--skip must be one of {', '.join(OFFERED)}, not {name}")
    for name in (wanted.specimen, wanted.inner):
        if name not in (None, "simulated") and not Path(name).is_file():
            what = "is a folder" if Path(name).is_dir() else "does not exist"
            raise InvalidInputError(f"{name} {what}: expected the file of a skull")
    if wanted.threshold is not None and not math.isfinite(wanted.threshold):
        raise InvalidInputError(f"--threshold must be a number, not {wanted.threshold}")
    if wanted.out is not None:
        folder = wanted.out.resolve().parent
        if wanted.out.is_dir():
            raise InvalidInputError(f"{wanted.out} is a folder: name a file in it")
        if not folder.is_dir():
            raise InvalidInputError(f"there is no folder {folder}: make it first")
        if not os.access(folder, os.W_OK):
            raise InvalidInputError(f"the folder {folder} cannot be written to: choose another")


@contextmanager
def _bars() -> Generator[Callable[[str, float], None]]:
    """Draw one bar for each step on stderr; yields a function that receives the share of a step."""
    tasks: dict[str, TaskID] = {}
    columns = (
        TextColumn("{task.description:<10}"),
        BarColumn(40),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as progress:

        def show(step: str, share: float) -> None:
            if step not in tasks:
                tasks[step] = progress.add_task(step, total=1.0)
            progress.update(tasks[step], completed=share)

        yield show


def _print_figures(figures: dict[str, Any], session: Session) -> None:
    known = (figures.get(name) for name in ("specimen", "robot", "world"))
    head = ", ".join((f"seed {figures.get('seed')}", *map(str, known)))
    table = Table(title=f"Against ground truth: {head}", title_justify="left", pad_edge=False)
    for column in ("figure", "value", "limit", "verdict", "paper"):
        right = column in ("value", "limit", "paper")
        table.add_column(column, justify="right" if right else "left")
    section = ""
    for row in quality_rows(figures, session):
        if row.section != section:
            section = row.section
            table.add_section()
            table.add_row(Text(section, "bold"))
        table.add_row(
            row.title,
            row.value_words or "-",
            row.limit_words,
            Text(row.verdict, COLOURS[row.verdict]) if row.verdict in COLOURS else "",
            row.paper_words,
        )
    console = Console()
    console.print(table)
    for row in quality_rows(figures, session):
        if row.remedy is not None:
            words = f"{row.title}: {row.verdict}. What helps: {row.remedy.words}"
            console.print(Text(words, COLOURS[row.verdict]), soft_wrap=True)
    if figures.get("completed"):
        console.print(f"completed in {figures.get('wall_s', 0.0):.0f} s", highlight=False)
    else:
        text = f"ended at stage {figures.get('failed_step')}: {figures.get('reason')}"
        console.print(Text(text, "red"), soft_wrap=True)
