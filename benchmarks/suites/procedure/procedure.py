"""The whole procedure, over seeds of the simulated skull and over real skulls where present.

Each run is ``rona_core.compose.run_demo``; ``robot_share`` and ``published_speed`` here compute
what ``OF_RESULTS`` declares.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

from benchmarks.metric import Direction, Metric, Progress, over_seeds
from benchmarks.timed_procedure import share_metrics, timed_procedure
from rona_core.app.declarations.figures import FIGURES, Figure
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.compose import DemoSkull, build_virtual_rig, new_workbench, run_demo
from rona_core.devices.world_settings import REALISTIC_WORLD, WorldSettings
from rona_core.evaluation.map_metrics import outer_errors_mm, thickness_errors_mm
from rona_core.evaluation.scan_metrics import detected_passes, detection_figures
from rona_core.evaluation.truth import Figures, rms, truth_of
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


OF_RESULTS = {  # figures that need more than the session of a run
    figure.key: figure
    for figure in (
        Figure(
            "outer_robot_rms_mm",
            "Outer boundary, by the robot",
            "mm",
            "RMS of the robot's systematic error along the true normal, over the cells of the "
            "outer map",
        ),
        Figure(
            "thickness_published_speed_rms_mm",
            "Thickness at the published speed, RMS",
            "mm",
            "`thickness_rms_mm` without a caliper, at the published speed",
        ),
        Figure(
            "unflagged_failure_published_speed_fraction",
            "Wrong inner boundary at the published speed, unflagged",
            "",
            "`unflagged_failure_fraction` without a caliper, at the published speed",
        ),
    )
}
KEYS = (
    "surface_rms_mm",
    "surface_sigma_predicted_mm",
    "normal_error_median_deg",
    "normal_error_p95_deg",
    "outer_rms_mm",
    "outer_robot_rms_mm",
    "outer_same_robot_rms_mm",
    "outer_other_roll_rms_mm",
    "thickness_rms_mm",
    "thickness_published_speed_rms_mm",
    "thickness_sigma_predicted_mm",
    "inner_rms_mm",
    "inner_same_robot_rms_mm",
    "fused_outer_rms_mm",
    "coverage_fraction",
    "inner_coverage_one_pass_fraction",
    "inner_coverage_fraction",
    "unflagged_failure_fraction",
    "unflagged_failure_published_speed_fraction",
    "detection_failure_fraction",
    "flagged_fraction",
)
REPORTED = tuple({**FIGURES, **OF_RESULTS}[key] for key in KEYS)


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
        yield _judged("simulated", *run_demo(seed, world=world))
    for name in SKULLS:
        path = data_folder() / name
        if path.is_file():
            progress(f"{world.profile} world, {name}")
            skull = DemoSkull(str(path))
            yield _judged(name.partition("_mask")[0], *run_demo(0, skull, world=world))
        else:
            progress(f"{name} is not there: left out")


def _judged(specimen: str, session: Session, figures: Mapping[str, object]) -> Run:
    """Return a run with the figures that need more than its session."""
    more = {**robot_share(session), **published_speed(session)}
    return Run(specimen, session.setup.seed, {**figures, **more})


def published_speed(session: Session) -> Figures:
    """Return figures of the thickness without reference points: at the published mean speed.

    The error of the map, and the share of unflagged A-scans that are wrong by over 1 mm. All else
    is as it was. None where there is no such map, or no thickness in it.
    """
    error, wrong = "thickness_published_speed_rms_mm", "unflagged_failure_published_speed_fraction"
    if session.results.maps is None:
        return {error: None, wrong: None}
    bench = new_workbench(session.with_capture("references", None).with_result("speed", None))
    try:
        bench.run(StartMapping())
        without = bench.session
    finally:
        bench.close()
    made, truth = without.results.maps, truth_of(session, build_virtual_rig(session.setup).scene)
    failures = detection_figures(detected_passes(without), truth)["unflagged_failure_fraction"]
    return {
        error: None if made is None else rms(thickness_errors_mm(made.value, truth)),
        wrong: failures,
    }


def robot_share(session: Session) -> dict[str, float | None]:
    """Return what the robot's systematic error does to the outer map, along the true normal.

    It is how far the places where the robot arrives, sent to the mapped points, are from those
    points: what the same robot does not see. None before there is a map.
    """
    made = session.results.maps
    if made is None or not made.value.outer.ok.any():
        return {"outer_robot_rms_mm": None}
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    points = made.value.outer.points_base()
    off = outer_errors_mm(points, truth, True) - outer_errors_mm(points, truth, False)
    return {"outer_robot_rms_mm": rms(off)}


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
