"""The whole procedure, over seeds of the simulated skull and over real skulls where present.

Each run is ``rona_core.compose.run_demo``; docs/metrics.md says what each figure means, and
``robot_share`` here what ``outer_robot_rms_mm`` is.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

from benchmarks.metric import Direction, Metric, Progress, over_seeds
from rona_core.app.overview.acceptance import FIGURES
from rona_core.compose import DemoSkull, build_virtual_rig, run_demo
from rona_core.evaluation.figures import rms
from rona_core.evaluation.map_metrics import outer_errors_mm
from rona_core.evaluation.truth import Truth
from rona_core.session.document import Session

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


@dataclass(frozen=True, slots=True)
class Aim:
    """A figure that is reported, what it shall be, and what the paper states."""

    key: str
    unit: str
    direction: Direction
    goal: float | None = None
    paper: float | None = None


KEYS = (
    "surface_rms_mm",
    "surface_sigma_predicted_mm",
    "normal_error_median_deg",
    "normal_error_p95_deg",
    "outer_rms_mm",
    "outer_robot_rms_mm",
    "outer_same_robot_rms_mm",
    "thickness_rms_mm",
    "inner_rms_mm",
    "inner_same_robot_rms_mm",
    "fused_outer_rms_mm",
    "coverage_fraction",
    "inner_coverage_fraction",
    "unflagged_failure_fraction",
    "detection_failure_fraction",
    "flagged_fraction",
)


def _aim(key: str) -> Aim:
    """Return the aim for a figure: the limit that the program judges it by."""
    kind = FIGURES.get(key)
    if kind is None:
        return Aim(key, "mm", "lower")
    direction: Direction = "lower" if kind.sense == "at most" else "higher"
    return Aim(key, kind.unit or "share", direction, kind.limit, kind.paper)


AIMS = tuple(_aim(key) for key in KEYS)


def data_folder() -> Path:
    """Return the folder of the real skulls: ``RONA_SHARED``, else beside the repository."""
    beside = Path(__file__).resolve().parents[3].parent / "shared"
    return Path(os.environ.get("RONA_SHARED", beside)) / "data"


def runs(progress: Progress) -> Iterator[Run]:
    """Yield every run; a skull that is not there is left out, and said so."""
    for seed in SEEDS:
        progress(f"simulated skull, seed {seed}")
        session, figures = run_demo(seed)
        yield Run("simulated", seed, {**figures, **robot_share(session)})
    for name in SKULLS:
        path = data_folder() / name
        if path.is_file():
            progress(name)
            session, figures = run_demo(0, DemoSkull(str(path)))
            yield Run(name.partition("_mask")[0], 0, {**figures, **robot_share(session)})
        else:
            progress(f"{name} is not there: left out")


def robot_share(session: Session) -> dict[str, float | None]:
    """Return what the robot's systematic error does to the outer map, along the true normal.

    It is how far the places where the robot arrives, sent to the mapped points, are from those
    points: what the same robot does not see. None before there is a map.
    """
    made = session.results.maps
    if made is None or not made.value.outer.ok.any():
        return {"outer_robot_rms_mm": None}
    points, truth = made.value.outer.points_base(), Truth(build_virtual_rig(session.setup).scene)
    off = outer_errors_mm(points, truth, True) - outer_errors_mm(points, truth, False)
    return {"outer_robot_rms_mm": rms(off)}


def summary(done: Sequence[Run]) -> list[Metric]:
    """Return median and worst of each figure, and how many runs came to their end."""
    metrics: list[Metric] = []
    for aim in AIMS:
        values = [run.number(aim.key) for run in done]
        peer = "paper" if aim.paper is not None else None
        metrics += over_seeds(
            aim.key,
            values,
            aim.unit,
            aim.direction,
            goal=aim.goal,
            peer=peer,
            peer_value=aim.paper,
        )
    completed = float(sum(run.figures.get("completed") is True for run in done))
    goal = float(ceil(SHARE_COMPLETED * len(done)))
    metrics.append(Metric(f"completed, of {len(done)}", completed, "runs", "higher", goal))
    times = [run.number("wall_s") for run in done]
    return metrics + over_seeds("wall_s", times, "s", "lower")


def run(progress: Progress) -> list[Metric]:
    """Run the procedure everywhere and return the summary."""
    return summary(list(runs(progress)))
