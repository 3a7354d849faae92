"""``python -m benchmarks [SUITE ...]``: run suites and print their figures.

Suites that would take more than five minutes of one core run fewer seeds by default
(``benchmarks/default_case.py``); ``--full`` runs the whole. The exit status is 1 where a figure
misses its goal, or its peer where it has none. ``--seeds N`` takes so many seeds in
suites that have some; ``--smallest`` shows in seconds that a suite runs, and its figures tell
nothing.
"""

import argparse
import importlib
import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from benchmarks.default_case import DEFAULT
from benchmarks.metric import Metric
from benchmarks.smallest import SMALLEST, set_to

# suite -> the room of ``benchmarks/suites`` that it stands in
SUITES: Mapping[str, str] = {
    "navigation": "navigation",
    "base_marker": "navigation",
    "hand_eye": "navigation",
    "path": "navigation",
    "robot": "robot",
    "roll": "robot",
    "timing": "robot",
    "collision": "robot",
    "base_placement": "robot",
    "contact": "robot",
    "echo_model": "ultrasound",
    "ultrasound": "ultrasound",
    "skull_suite": "ultrasound",
    "bone_kinds": "ultrasound",
    "recorded_rf": "ultrasound",
    "sound_speed": "ultrasound",
    "thickness": "ultrasound",
    "rank_ceiling": "ultrasound",
    "volume": "ultrasound",
    "start": "procedure",
    "viewer": "procedure",
    "kills": "reliability",
    "saving": "reliability",
    "stop": "reliability",
    "connections": "reliability",
    "readers": "reliability",
    "procedure": "procedure",
    "mounting": "procedure",
    "head_motion": "procedure",
    "speed": "procedure",
    "honesty": "honesty",
    "accuracy": "accuracy",
    "passes": "accuracy",
    "pass_faults": "accuracy",
    "probe_choice": "accuracy",
    "map_ranks": "accuracy",
    "implant": "implant",
    "placement": "implant",
    "beds": "implant",
    "rehearsal": "implant",
    "force_guard": "implant",
    "bed_lines": "implant",
}
Case = Literal["default", "full", "smallest"]
COLUMNS = ("figure", "value", "unit", "goal", "peer", "holds")


def run_suite(name: str, seeds: int | None = None, case: Case = "default") -> list[Metric]:
    """Return the figures of one suite; what it is doing goes to standard error.

    Args:
        name: Of the suite.
        seeds: How many seeds to take from its first one on, where the suite has any.
        case: How much of it to run.
    """
    module = f"suites.{SUITES[name]}.{name}"
    suite = importlib.import_module(f"benchmarks.{module}")
    changes = changes_for(name, case)
    if seeds is not None and hasattr(suite, "SEEDS"):
        first = next(iter(suite.SEEDS))
        changes[f"{module}.SEEDS"] = range(first, first + seeds)

    def progress(text: str) -> None:
        print(f"{name}: {text}", file=sys.stderr, flush=True)

    progress(case_name(name, case))
    with set_to(changes):
        return suite.run(progress)


def changes_for(name: str, case: Case) -> dict[str, Any]:
    """Return the constants, with their values, that differ from those of the whole suite."""
    held: Mapping[Case, Mapping[str, Mapping[str, Any]]] = {
        "default": DEFAULT,
        "smallest": SMALLEST,
    }
    return dict(held[case].get(name, {})) if case in held else {}


def case_name(name: str, case: Case) -> str:
    """Return how much of a suite runs, in words."""
    if case == "smallest":
        return "smallest case"
    if case == "full" or name not in DEFAULT:
        return "the whole suite"
    return "fewer seeds than with --full"


def as_number(value: float | None) -> str:
    """Return four significant digits, a dash for nothing."""
    return "-" if value is None else f"{value:.4g}"


def as_row(metric: Metric) -> tuple[str, ...]:
    """Return one line of the table."""
    sign = "<=" if metric.direction == "lower" else ">="
    goal = "-" if metric.goal is None else f"{sign} {as_number(metric.goal)}"
    peer = "-" if metric.peer is None else f"{metric.peer} {as_number(metric.peer_value)}"
    holds = {True: "yes", False: "NO", None: "-"}[metric.holds]
    return (metric.name, as_number(metric.value), metric.unit, goal, peer, holds)


def as_table(metrics: Sequence[Metric]) -> str:
    """Return the figures as plain text in columns."""
    rows = [COLUMNS, *(as_row(metric) for metric in metrics)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]
    rows.insert(1, tuple("-" * width for width in widths))
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(line.rstrip() for line in lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what was asked for; return 1 where a figure does not hold, unless in smallest cases."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("suites", nargs="*", metavar="SUITE", help=f"of {', '.join(SUITES)}")
    parser.add_argument("--json", action="store_true", help="print a list of objects")
    parser.add_argument("--seeds", type=int, help="take so many seeds where a suite has some")
    much = parser.add_mutually_exclusive_group()
    much.add_argument("--full", action="store_true", help="run the whole, however long it takes")
    much.add_argument("--smallest", action="store_true", help="see in seconds that suites run")
    options = parser.parse_args(arguments)
    if options.seeds is not None and options.seeds < 1:
        parser.error(f"--seeds {options.seeds}: at least one seed is needed")
    unknown = [name for name in options.suites if name not in SUITES]
    if unknown:
        parser.error(f"there is no suite {unknown[0]!r}; the suites are {', '.join(SUITES)}")
    case: Case = "full" if options.full else "smallest" if options.smallest else "default"
    metrics: list[Metric] = []
    for name in options.suites or SUITES:
        found = run_suite(name, options.seeds, case)
        metrics += found
        if not options.json:
            print(f"\n{name}: {case_name(name, case)}\n\n{as_table(found)}", flush=True)
    if options.json:
        print(json.dumps([metric.as_dict() for metric in metrics], indent=2))
    judged = [metric.holds for metric in metrics if metric.holds is not None]
    print(f"\n{sum(judged)} of {len(judged)} goals hold", file=sys.stderr)
    return int(case != "smallest" and not all(judged))


if __name__ == "__main__":
    sys.exit(main())
