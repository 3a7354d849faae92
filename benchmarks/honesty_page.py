"""``make honesty``: hold every predicted sigma against the truth and write docs/honesty.md."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.__main__ import Case, changes_for
from benchmarks.metric import row
from benchmarks.smallest import set_to
from benchmarks.suites.honesty import honesty as suite
from benchmarks.suites.honesty.judged import (
    BAND_GOAL,
    RANK_GOAL,
    RATIO_GOAL,
    Honesty,
    Judged,
    Statistic,
    band_goal,
    grouped,
    honesty,
    rank_goal,
    ratio_goal,
)
from examples.picture import Series, chart

DOCS = Path(__file__).resolve().parents[1] / "docs"

BINS = 10
HEADS = ("quantity", "part", "seeds", "RMS error", "RMS sigma", "ratio", "band", "rank", "drawn")

INTRODUCTION = f"""# Honesty

Made by `make honesty FULL=1`, not by hand (`make honesty` takes fewer seeds). What the program
predicts of its own errors, held against the truth in the [realistic world](world.md) that no
algorithm knows. Each seed has its tracker, robot and pointer by a balanced design, every pair about
equally often (`benchmarks/suites/honesty/design.py`). Nothing was tuned on these seeds.

What robot and tracker do the same every time is assumed to be about as large as stated, as it is in
this world. Where the robot errs by twice as much the maps miss their bands, and in 29 of 36
sessions [residuals or landmarks](algorithms/navigation/tool_registration.md) warn of it; where it
errs as stated, in 5 of 54.

*Ratio*: mean of (error / predicted sigma)², honest is 1, goal {RATIO_GOAL[0]:g} to
{RATIO_GOAL[1]:g}. *Band*: share of errors within 1.96 sigma, honest is 0.95, goal
{BAND_GOAL[0]:g} to {BAND_GOAL[1]:g}.
*Rank*: correlation of sigma and size of the error among the places of a session, for a sigma that
claims to tell good places from bad ones. *Drawn*: what it is for normal errors, each drawn by
itself with these sigmas. Errors that are seldom, but then a whole cycle of the echo, reach less
however honest the sigmas ([why](algorithms/ultrasound/sound_speed.md)). The goal of *rank* is
{RANK_GOAL:g}, or *drawn* where that is less.

Every seed counts the same, whatever its number of samples; in brackets the 95 % interval, by
drawing seeds with replacement. What misses its goal is bold. A *common* part is one error for a
whole session (of a vector its parts along the axes of its covariance, so that the ratio is that of
Mahalanobis), a *local* one differs from place to place, *whole* is both. Of *common* and *whole*
there are about as few independent numbers as seeds: where the range that honest sigmas keep in
95 % of studies of this size (chi squared, binomial) is wider than the goal, it counts.
"""


def page(found: Mapping[str, suite.CaseSamples]) -> str:
    """Return the page for what the cases found."""
    lines = [INTRODUCTION]
    for name, case in found.items():
        judged = [honesty(group) for group in grouped(case.samples).values()]
        lines += [
            f"## {name[0].upper() + name[1:]}\n",
            f"{case.seeds} seeds, {case.refused:.0%} of them refused by a step.\n",
            row(*HEADS),
            row(*["---"] * len(HEADS)),
            *(as_row(one) for one in judged),
            "",
            *(f"![{title(one)}](images/honesty/{file_name(one)})" for one in judged),
            "",
        ]
    return "\n".join(lines)


def as_row(found: Honesty) -> str:
    """Return one quantity as a row of the table; what misses its goal is bold."""
    rank = "" if found.rank is None else as_cell(found.rank, (rank_goal(found), 1.0))
    drawn = "" if found.drawn_rank is None else f"{found.drawn_rank:.2f}"
    return row(
        found.quantity,
        found.part,
        found.seeds,
        f"{found.rms_error:.3f}",
        f"{found.rms_sigma:.3f}",
        as_cell(found.ratio, ratio_goal(found)),
        as_cell(found.band, band_goal(found)),
        rank,
        drawn,
    )


def as_cell(found: Statistic, goal: tuple[float, float]) -> str:
    """Return value and interval, bold where the goal is missed."""
    if found.value is None or found.low is None or found.high is None:
        return "-"
    held = goal[0] <= found.value <= goal[1]
    value = f"{found.value:.2f}" if held else f"**{found.value:.2f}**"
    return f"{value} ({found.low:.2f} to {found.high:.2f})"


def picture(samples: Sequence[Judged]) -> str:
    """Return a chart of observed over predicted errors: one dot a seed, and in tenths by sigma."""
    samples = [one for one in samples if len(one.errors)]
    errors = np.concatenate([one.errors for one in samples])
    sigmas = np.concatenate([one.sigmas for one in samples])
    order = np.array_split(np.argsort(sigmas), min(BINS, len(sigmas)))
    tenths = [(rms(sigmas[rows]), rms(errors[rows])) for rows in order]
    seeds = [(rms(one.sigmas), rms(one.errors)) for one in samples]
    most = max(sigma for sigma, _ in seeds)
    series = [
        Series("each seed", *np.array(seeds).T, dots=True),
        Series("tenths of all samples, by sigma", *np.array(tenths).T),
        Series("honest", [0.0, most], [0.0, most]),
    ]
    found = honesty(samples)
    return chart(title(found), "predicted RMS", "observed RMS", series)


def rms(values: np.ndarray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt((values**2).mean()))


def title(found: Honesty) -> str:
    """Return how a quantity is called above its chart."""
    return f"{found.quantity}, {found.part}"


def file_name(found: Honesty) -> str:
    """Return the name of the chart of a quantity."""
    words = "".join(c if c.isalnum() else " " for c in title(found).lower()).split()
    return f"{'_'.join(words)}.svg"


def write(found: Mapping[str, suite.CaseSamples], docs: Path = DOCS) -> None:
    """Write page and charts below a folder."""
    charts = docs / "images" / "honesty"
    charts.mkdir(parents=True, exist_ok=True)
    for old in charts.glob("*.svg"):
        old.unlink()
    for case in found.values():
        for group in grouped(case.samples).values():
            (charts / file_name(honesty(group))).write_text(picture(group), "utf-8")
    (docs / "honesty.md").write_text(page(found), "utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge everything and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.honesty_page", description=__doc__)
    parser.add_argument("--full", action="store_true", help="take all seeds")
    case: Case = "full" if parser.parse_args(arguments).full else "default"
    with set_to(changes_for("honesty", case)):
        write(suite.everything(lambda text: print(text, file=sys.stderr, flush=True)))
    print("wrote honesty.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
