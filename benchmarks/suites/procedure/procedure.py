"""The whole procedure, over seeds of the simulated skull and over real skulls where present."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

from benchmarks.metric import Direction, Metric, Progress, over_seeds
from benchmarks.timed_procedure import share_metrics, timed_procedure
from rona_core.app.declarations.figures import FIGURES
from rona_core.compose import DemoSkull, run_demo
from rona_core.devices.world_settings import REALISTIC_WORLD, WorldSettings

SEEDS = range(10)
SKULLS = ("skull_c_mask.nrrd", "skull_d_mask.nii.gz")
SHARE_COMPLETED = 9 / 12


@dataclass(frozen=True, slots=True)
class Run:
    """One procedure: which specimen, which seed, and its figures by the keys of metrics.md."""

    specimen: str
    seed: int
    figures: Mapping[str, object]

    def number(self, key: str) -> float | None:
        """Return one figure, None where the run did not get there."""
        value = self.figures.get(key)
        return float(value) if isinstance(value, int | float) else None


KEYS = (
    "surface_rms_mm",
    "surface_sigma_predicted_mm",
    "normal_error_median_deg",
    "normal_error_p95_deg",
    "outer_rms_mm",
    "outer_same_robot_rms_mm",
    "outer_other_roll_rms_mm",
    "thickness_rms_mm",
    "thickness_sigma_predicted_mm",
    "inner_rms_mm",
    "inner_same_robot_rms_mm",
    "fused_outer_rms_mm",
    "coverage_fraction",
    "inner_coverage_one_pass_fraction",
    "inner_coverage_fraction",
    "unflagged_failure_fraction",
    "detection_failure_fraction",
    "flagged_fraction",
)
REPORTED = tuple(FIGURES[key] for key in KEYS)


def data_folder() -> Path:
    """Return the folder of the real skulls: ``RONA_SHARED``, else beside the repository."""
    beside = Path(__file__).resolve().parents[3].parent / "shared"
    return Path(os.environ.get("RONA_SHARED", beside)) / "data"


def runs(
    progress: Progress, seeds: Sequence[int], world: WorldSettings = REALISTIC_WORLD
) -> Iterator[Run]:
    """Yield every run in a world; a skull that is not there is left out, and said so."""
    for seed in seeds:
        progress(f"{world.profile} world, simulated skull, seed {seed}")
        yield Run("simulated", seed, run_demo(seed, world=world)[1])
    for name in SKULLS:
        path = data_folder() / name
        if path.is_file():
            progress(f"{world.profile} world, {name}")
            skull = DemoSkull(str(path))
            yield Run(name.partition("_mask")[0], 0, run_demo(0, skull, world=world)[1])
        else:
            progress(f"{name} is not there: left out")


def summary(done: Sequence[Run]) -> list[Metric]:
    """Return median and worst of each figure, and how many runs came to their end."""
    metrics: list[Metric] = []
    for figure in REPORTED:
        direction: Direction = "lower" if figure.sense == "at most" else "higher"
        metrics += over_seeds(
            figure.key,
            [run.number(figure.key) for run in done],
            figure.unit or "share",
            direction,
            goal=figure.limit,
            peer=None if figure.paper is None else "paper",
            peer_value=figure.paper,
        )
    completed = float(sum(run.figures.get("completed") is True for run in done))
    goal = float(ceil(SHARE_COMPLETED * len(done)))
    metrics.append(Metric(f"completed, of {len(done)}", completed, "runs", "higher", goal))
    times = [run.number("wall_s") for run in done]
    return metrics + over_seeds("wall_s", times, "s", "lower")


def run(progress: Progress) -> list[Metric]:
    """Run the procedure everywhere; return the summary, and what share of CPU each step takes."""
    metrics = summary(list(runs(progress, SEEDS)))
    progress("share of each step")
    return metrics + share_metrics(timed_procedure(next(iter(SEEDS))))
