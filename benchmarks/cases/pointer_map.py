"""Error of the pointer's map of the surface through the whole chain: tool, pointer, strokes."""

import math
import os
import statistics
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from multiprocessing import get_context

from benchmarks.metric import Metric, Progress
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetSeed, SetTracker
from rona_core.app.steps.surface.messages import BuildSurface, StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.devices.settings import TrackerProfile
from rona_core.session.document import Session

SEEDS = range(20)
AVERAGE_S = 0.2
PAPER_MM = 2.5


@dataclass(frozen=True, slots=True)
class MapErrors:
    """RMS distance of the cloud from the true bone, by how long each point was averaged."""

    usual_mm: float
    single_mm: float
    averaged_mm: float


def map_errors(seed: int, profile: TrackerProfile) -> MapErrors:
    """Return the errors of one patient under one profile of the tracker."""
    bench = new_workbench(Session())
    try:
        bench.dispatch(SetSeed(seed))
        bench.dispatch(SetTracker(profile=profile))
        for activity in (StartToolCapture(), StartPointerCapture(), StartSurfaceCapture()):
            bench.run(activity)
        found: list[float] = []
        for message in (BuildSurface(), BuildSurface(0.0), BuildSurface(AVERAGE_S)):
            bench.dispatch(message)
            found.append(float(bench.figures()["surface_rms_mm"]))
        return MapErrors(*found)
    finally:
        bench.close()


def pointer_map_metrics(progress: Progress) -> list[Metric]:
    """Return the map's error over patients, as it is by default and under white noise."""
    metrics: list[Metric] = []
    seeds = SEEDS
    workers = min(os.cpu_count() or 1, 4)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        progress(f"pointer maps of {len(seeds)} patients, profile polaris")
        polaris = list(pool.map(map_errors, seeds, repeat("polaris")))
        usual = [errors.usual_mm for errors in polaris]
        metrics += _over(seeds, "surface_rms_mm, polaris", usual, median=0.4, worst=0.8)
        progress(f"pointer maps of {len(seeds)} patients, profile white035")
        white = list(pool.map(map_errors, seeds, repeat("white035")))
        single = [errors.single_mm for errors in white]
        metrics += _over(seeds, "surface_rms_mm, white035, single frames", single, median=0.8)
        averaged = [errors.averaged_mm for errors in white]
        name = f"surface_rms_mm, white035, averaged over {AVERAGE_S} s"
        metrics += _over(seeds, name, averaged, median=0.4)
    return metrics


def _over(
    seeds: Sequence[int], name: str, values: list[float], *, median: float, worst: float = math.inf
) -> list[Metric]:
    goal = None if math.isinf(worst) else worst
    return [
        Metric(
            f"{name} (median)",
            statistics.median(values) if values else None,
            "mm",
            "lower",
            median,
            "paper",
            PAPER_MM,
        ),
        Metric(f"{name} (worst of {len(seeds)})", max(values, default=None), "mm", "lower", goal),
    ]
