"""``make results``: run the procedure over seeds and skulls and write docs/results.md."""

import math
import platform
import re
import statistics
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import rona_core
from benchmarks.__main__ import as_number
from benchmarks.suites.procedure.procedure import REPORTED, SEEDS, Run, runs, summary
from rona_core.app.declarations.figures import FIGURES, PREDICTED
from rona_core.app.overview.acceptance import verdict
from rona_core.devices.world_settings import NOMINAL_WORLD, REALISTIC_WORLD

PATIENTS = range(35_000, 35_040)  # of the realistic world; nothing was adjusted with these
PAGE = Path(__file__).resolve().parents[1] / "docs" / "results.md"

INTRODUCTION = """# Results

Made by `make results`, not by hand. Each line is one run of the whole procedure, from set-up to
maps, with virtual devices and default settings; every figure is measured against the ground truth,
as [metrics](metrics.md) defines it. A dash: the run did not get that far. The
*realistic* world is the default; in the *nominal* one everything is as it is told
([the virtual world](world.md) says what is drawn).
"""


def page(done: Mapping[str, Sequence[Run]]) -> str:
    """Return the page for the runs in each world; goals are judged in the first of them."""
    lines = [
        INTRODUCTION,
        f"Version {rona_core.__version__}, Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}.\n",
        "## Summary\n",
        *summaries(done),
    ]
    for world, runs_there in done.items():
        lines += ["", *every_run(world, runs_there)]
    return "\n".join(lines) + "\n"


def summaries(done: Mapping[str, Sequence[Run]]) -> list[str]:
    """Return the table of medians and worst figures, a column for each world."""
    tables = [
        [metric for metric in summary(runs_there) if metric.unit != "s"]  # of one machine
        for runs_there in done.values()
    ]
    counts = (f"{world}, {len(runs_there)} runs" for world, runs_there in done.items())
    heads = ("figure", *counts, "unit", "goal", "paper", "holds")
    lines = [row(*heads), row(*["---"] * len(heads))]
    for metrics in zip(*tables, strict=True):
        first = metrics[0]
        holds = {True: "yes", False: "**no**", None: ""}[first.holds]
        goal, paper = as_number(first.goal), as_number(first.peer_value)
        values = (as_number(metric.value) for metric in metrics)
        name = re.sub(r",? of \d+", "", first.name)  # how many runs those are stands above
        lines.append(row(name, *values, first.unit, goal, paper, holds))
    return lines


def every_run(world: str, done: Sequence[Run]) -> list[str]:
    """Return the table of all runs in one world, and why some did not come to their end."""
    keys = [figure.key for figure in REPORTED]
    stopped = [run for run in done if run.figures.get("completed") is not True]
    return [
        f"## Every run, {world} world\n",
        row("skull", "seed", "completed", *keys),
        row(*("---" for _ in range(len(keys) + 3))),
        *(
            row(r.specimen, r.seed, outcome(r), *(as_number(r.number(k)) for k in keys))
            for r in done
        ),
        row("**paper**", "", "", *(as_number(figure.paper) for figure in REPORTED)),
        *what_the_outer_error_is(done),
        *what_the_program_said(done),
        *(
            f"\n{r.specimen}, seed {r.seed}, stopped at step {r.figures.get('failed_step')}: "
            f"{r.figures.get('reason')}"
            for r in stopped
        ),
    ]


def what_the_outer_error_is(done: Sequence[Run]) -> list[str]:
    """Return the words that say what the figures of the outer map tell, and what they do not."""
    keys = ("outer_rms_mm", "outer_robot_rms_mm", "outer_same_robot_rms_mm")
    rows = [[run.number(key) for key in keys] for run in done]
    whole = [[value for value in found if value is not None] for found in rows]
    known = [found for found in whole if len(found) == len(keys)]
    if not known:
        return []
    outer, robot, same = (
        math.sqrt(statistics.fmean(value**2 for value in values))
        for values in zip(*known, strict=True)
    )
    return [
        "\n**What the outer RMS is.** The robot is assumed to be off by a smooth field of 0.35 mm "
        "(3D RMS), and `outer_rms_mm` is mostly that field, seen along the normal: "
        f"`outer_robot_rms_mm`, {robot:.3f} of {outer:.3f} mm (quadratic means over the runs). It "
        "says what was assumed of the robot, and nothing of the method. What scan and map add is "
        f"`outer_same_robot_rms_mm`, {same:.3f} mm: the error where the same robot uses the map in "
        "the same posture, as the inner map's is `inner_same_robot_rms_mm`.",
    ]


def what_the_program_said(done: Sequence[Run]) -> list[str]:
    """Return the words on how many runs were refused, or told that they miss a limit."""
    stopped = sum(run.figures.get("completed") is not True for run in done)
    missed = {
        FIGURES[key].title: [run for run in done if _told_bad(run, key)]
        for key in FIGURES
        if key in PREDICTED
    }
    told = {(run.specimen, run.seed) for found in missed.values() for run in found}
    words = ", ".join(f"{title} {len(found)}" for title, found in missed.items() if found)
    return [
        f"\n**What the program said of itself**, without any truth: {stopped} of {len(done)} runs "
        f"were refused by a step, and {len(told)} have a predicted figure beyond its limit"
        f"{f' ({words})' if words else ''}.",
    ]


def _told_bad(run: Run, key: str) -> bool:
    kind = FIGURES[key]
    return verdict(run.number(key), kind.limit, kind.sense) in ("review", "fail")


def row(*cells: object) -> str:
    """Return one line of a table."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def outcome(run: Run) -> str:
    """Return yes, or the step that failed."""
    if run.figures.get("completed") is True:
        return "yes"
    return f"no: {run.figures.get('failed_step')}"


def main() -> int:
    """Run everything and write the page."""

    def tell(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    worlds = ((REALISTIC_WORLD, PATIENTS), (NOMINAL_WORLD, SEEDS))
    done = {world.profile: list(runs(tell, seeds, world)) for world, seeds in worlds}
    PAGE.write_text(page(done), "utf-8")
    count = sum(r.figures.get("completed") is True for found in done.values() for r in found)
    print(f"wrote {PAGE.name}: {count} completed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
