"""The command line: serve, demo, inspect."""

import argparse
import json
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from rona_core import __version__
from rona_core.errors import InvalidInputError, RonaError

OK, FAILED, BAD_INPUT, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130
DESCRIPTION = (
    "Plan, rehearse and evaluate a robot-held 3D ultrasound scan of the skull. "
    "Research software, not a medical device."
)
MARKS = {"pass": "pass", "review": "review", "fail": "fail", "none": ""}
COLOURS = {"pass": "green", "review": "yellow", "fail": "red", "none": ""}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit status: 0 done, 2 bad input, 3 could not be finished."""
    wanted = _parser().parse_args(arguments)
    try:
        return wanted.run(wanted)
    except RonaError as error:
        return _complain(str(error), BAD_INPUT)
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        return _complain(f"{error.strerror or error}{where}", BAD_INPUT)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except Exception as error:  # a defect: one line, unless somebody wants to see more
        if os.environ.get("RONA_DEBUG"):
            traceback.print_exc()
        text = f"{type(error).__name__}: {error} (a defect; RONA_DEBUG=1 shows where)"
        return _complain(text, FAILED)


def _complain(text: str, status: int) -> int:
    print(f"error: {' '.join(text.split())}", file=sys.stderr)
    return status


# ------------------------------------------------------------------ arguments


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="rona", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"rona {__version__}")
    verbs = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_serve(verbs)
    _add_demo(verbs)
    _add_inspect(verbs)
    return parser


def _verb(verbs: Any, name: str, run: Callable[[Any], int], text: str) -> argparse.ArgumentParser:
    verb: argparse.ArgumentParser = verbs.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}."
    )
    verb.set_defaults(run=run)
    return verb


def _add_serve(verbs: Any) -> None:
    verb = _verb(verbs, "serve", _serve, "start the program for the browser")
    verb.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: this machine only)"
    )
    verb.add_argument("--port", type=int, default=8642, help="port, 0 for a free one (8642)")
    verb.add_argument("--sessions", type=Path, metavar="DIR", help="folder of session files")
    verb.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="a further name that the server answers to; may be repeated",
    )
    verb.add_argument(
        "--no-auth",
        action="store_true",
        help="no token; only when listening on this machine (else RONA_TOKEN or a random one)",
    )
    verb.add_argument("--no-open", action="store_true", help="do not open a browser")
    verb.add_argument(
        "--pace",
        type=float,
        metavar="X",
        help="show captures at X times real time (default: 8); 0 for at once",
        default=8.0,
    )


def _add_demo(verbs: Any) -> None:
    verb = _verb(verbs, "demo", _demo, "carry out the complete procedure without a browser")
    verb.add_argument("--seed", type=int, default=0, help="patient, placement and noise (0)")
    verb.add_argument(
        "--specimen",
        default="simulated",
        metavar="simulated|FILE",
        help="simulated skull, or a file: mask or CT volume (.nrrd, .nii), mesh (.stl, .ply, .obj)",
    )
    verb.add_argument("--inner", metavar="FILE", help="inner surface, where it is another file")
    verb.add_argument(
        "--threshold", type=float, metavar="V", help="bone threshold of a CT, in its own units"
    )
    verb.add_argument(
        "--center",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="centre of the scanned region in mm, in coordinates of the specimen",
    )
    verb.add_argument("--radius", type=float, metavar="R", help="radius of the region in mm (25)")
    verb.add_argument("--robot", default="rx90", metavar="NAME", help="robot (rx90)")
    verb.add_argument("--out", type=Path, metavar="FILE", help="save the session here")
    verb.add_argument("--json", action="store_true", help="print one JSON object, no table")


def _add_inspect(verbs: Any) -> None:
    verb = _verb(verbs, "inspect", _inspect, "say what a session file holds")
    verb.add_argument("file", type=Path, metavar="FILE")
    verb.add_argument("--json", action="store_true", help="print one JSON object")


# ------------------------------------------------------------------ serve


def _serve(wanted: Any) -> int:
    from rona_core.compose import build_hub
    from rona_ui.resources import sessions_dir
    from rona_ui.server import ServerSettings, serve, token_from_environment
    from rona_ui.window import open_window

    pace = wanted.pace or None
    if pace is not None and not 0.0 < pace <= 1000.0:
        raise InvalidInputError(f"--pace must be 0 to 1000, not {wanted.pace:g}")
    folder = sessions_dir() if wanted.sessions is None else wanted.sessions.expanduser().resolve()
    folder.mkdir(parents=True, exist_ok=True)
    settings = ServerSettings(
        host=wanted.host,
        port=wanted.port,
        sessions=folder,
        allow_hosts=tuple(wanted.allow_host),
        token=None if wanted.no_auth else token_from_environment(),
        open_browser=not wanted.no_open,
    )

    def say(url: str) -> None:
        print(f"RONA is at {url}\nSessions are in {folder}. Ctrl-C ends it.", flush=True)

    serve(
        settings,
        build_hub=lambda place: build_hub(place, pace=pace),
        open_window=open_window,
        say=say,
    )
    return OK


# ------------------------------------------------------------------ demo


def _demo(wanted: Any) -> int:
    from rona_core.compose import run_demo
    from rona_core.session.files import save_session

    for name in (wanted.specimen, wanted.inner):
        if name not in (None, "simulated") and not Path(name).is_file():
            raise InvalidInputError(f"there is no file {name}")
    if wanted.out is not None and not wanted.out.resolve().parent.is_dir():
        raise InvalidInputError(f"there is no folder {wanted.out.resolve().parent}")
    with _Bars() as bars:
        session, figures = run_demo(
            wanted.seed,
            specimen=wanted.specimen,
            inner=wanted.inner,
            threshold=wanted.threshold,
            center=wanted.center,
            radius=wanted.radius,
            robot=wanted.robot,
            progress=bars.show,
        )
    if wanted.out is not None:
        save_session(session, wanted.out)
    if wanted.json:
        print(json.dumps(figures, allow_nan=False))
    else:
        _print_figures(figures, session)
        if wanted.out is not None:
            print(f"saved in {wanted.out}")
    return OK if figures.get("completed") else INCOMPLETE


class _Bars:
    """One bar for each step, on stderr."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description:<10}"),
            BarColumn(40),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> "_Bars":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, step: str, share: float) -> None:
        """Show that this share of a step is done."""
        if step not in self._tasks:
            self._tasks[step] = self._progress.add_task(step, total=1.0)
        self._progress.update(self._tasks[step], completed=share)


def _print_figures(figures: dict[str, Any], session: Any) -> None:
    from rona_core.app.quality import quality_rows

    head = f"seed {figures.get('seed')}, {figures.get('specimen')}, {figures.get('robot')}"
    table = Table(title=f"Against ground truth: {head}", title_justify="left", pad_edge=False)
    for column in ("figure", "value", "unit", "limit", "verdict", "paper"):
        right = column in ("value", "limit", "paper")
        table.add_column(column, justify="right" if right else "left")
    for row in quality_rows(figures, session):
        sign = "\u2264" if row.sense == "at most" else "\u2265"
        table.add_row(
            row.title,
            _number(row.value, row.decimals),
            row.unit,
            "" if row.limit is None else f"{sign} {row.limit:g}",
            Text(MARKS[row.verdict], COLOURS[row.verdict]),
            "" if row.paper is None else f"{row.paper:g}",
        )
    console = Console()
    console.print(table)
    if figures.get("completed"):
        console.print(f"completed in {figures.get('wall_s', 0.0):.0f} s", highlight=False)
    else:
        text = f"not completed: step {figures.get('failed_step')}: {figures.get('reason')}"
        console.print(Text(text, "red"), soft_wrap=True)


def _number(value: Any, decimals: int) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool | str):
        return str(value)
    return f"{value:.{decimals}f}"


# ------------------------------------------------------------------ inspect


def _inspect(wanted: Any) -> int:
    from rona_core.app.queries import step_states
    from rona_core.session.files import load_session
    from rona_core.session.migrate import SCHEMA

    session = load_session(wanted.file)
    steps = step_states(session)
    captures = [
        {"kind": type(capture).__name__, "ordinal": capture.ordinal, "partial": capture.partial}
        for capture in session.archive
    ]
    if wanted.json:
        facts = {
            "name": session.name,
            "id": session.id,
            "created_utc": session.created_utc,
            "schema": SCHEMA,
            "seed": session.setup.seed,
            "revision": len(session.log),
            "steps": {step.name: {"state": step.state, "reason": step.reason} for step in steps},
            "captures": captures,
        }
        print(json.dumps(facts, allow_nan=False))
        return OK
    print(f"{session.name}  (id {session.id}, made {session.created_utc})")
    print(f"seed {session.setup.seed}, revision {len(session.log)}, schema {SCHEMA}")
    for step in steps:
        print(f"  {step.number} {step.title:<10} {step.state:<8} {step.reason}")
    kinds = [f"{c['ordinal']} {c['kind']}" + (" (partial)" if c["partial"] else "") for c in captures]
    print(f"captures: {', '.join(kinds) or 'none'}")
    results = _result_names(session)
    print(f"results: {', '.join(results) or 'none'}")
    return OK


def _result_names(session: Any) -> list[str]:
    from rona_core.app.inputs import RESULTS

    return [name for name in RESULTS if getattr(session.results, name) is not None]
