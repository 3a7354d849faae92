"""``make results``: run the procedure over seeds and skulls and write docs/results.md."""

import math
import platform
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

import rona_core
from benchmarks.__main__ import as_number
from benchmarks.suites.procedure.procedure import AIMS, Run, runs, summary

PAGE = Path(__file__).resolve().parents[1] / "docs" / "results.md"

INTRODUCTION = """# Results

Made by `make results`, not by hand. Each line is one run of the whole procedure, from set-up to
maps, with virtual devices and default settings; every figure is measured against the ground truth,
as [metrics](metrics.md) defines it. A dash: the run did not get that far.
"""


def page(done: Sequence[Run]) -> str:
    """Return the page for some runs."""
    keys = [aim.key for aim in AIMS]
    lines = [
        INTRODUCTION,
        f"Version {rona_core.__version__}, Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}.\n",
        "## Every run\n",
        row("skull", "seed", "completed", *keys),
        row(*("---" for _ in range(len(keys) + 3))),
        *(
            row(r.specimen, r.seed, outcome(r), *(as_number(r.number(k)) for k in keys))
            for r in done
        ),
        row("**paper**", "", "", *(as_number(aim.paper) for aim in AIMS)),
        *what_the_outer_error_is(done),
        "\n## Runs that did not complete\n",
        "\n".join(
            f"* {r.specimen}, seed {r.seed}, step {r.figures.get('failed_step')}: "
            f"{r.figures.get('reason')}"
            for r in done
            if r.figures.get("completed") is not True
        )
        or "None.",
        "\n## Summary\n",
        row("figure", "value", "unit", "goal", "paper", "holds"),
        row(*["---"] * 6),
    ]
    for metric in summary(done):
        holds = {True: "yes", False: "**no**", None: ""}[metric.holds]
        goal, paper = as_number(metric.goal), as_number(metric.peer_value)
        lines.append(row(metric.name, as_number(metric.value), metric.unit, goal, paper, holds))
    return "\n".join(lines) + "\n"


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
    done = list(runs(lambda text: print(text, file=sys.stderr, flush=True)))
    PAGE.write_text(page(done), "utf-8")
    print(f"wrote {PAGE.name}: {sum(r.figures.get('completed') is True for r in done)} completed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
