"""The outer map with a warm delay line and a probe that is clamped off its place.

One pass of the whole procedure with virtual devices over seeds, in a nominal world but for a line
10 K warmer than told, and a probe 0.3 mm off its place in a direction that belongs to the seed.
Mapped as it is, and once more after the gauge plate; errors are those for the same robot.
"""

import numpy as np

from benchmarks.metric import Metric, Progress, over_seeds
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.messages import StartProbeMountingCapture
from rona_core.app.steps.setup.messages import SetSeed, SetWorld
from rona_core.compose import build_virtual_rig, new_workbench
from rona_core.evaluation.map_metrics import outer_errors_mm
from rona_core.evaluation.truth import rms, truth_of
from rona_core.session.document import Session

SEEDS = range(30_000, 30_006)
WARMER_K, OFF_MM = 10.0, 0.3
ONE_PASS = stages("caliper", skip=("tilts", "tilted"))
GOAL_RMS_MM, GOAL_BIAS_MM = 0.08, 0.05


def run(progress: Progress) -> list[Metric]:
    """Return RMS and bias of the outer map without and with the gauge plate."""
    found: dict[str, list[tuple[float | None, float]]] = {"as it is": [], "gauge plate": []}
    for seed in SEEDS:
        progress(f"seed {seed}")
        bench = new_workbench(Session(name=f"mounting, seed {seed}"))
        bench.dispatch(SetSeed(seed))
        bench.dispatch(SetWorld(line_excess_k=WARMER_K, mounting_mm=OFF_MM))
        if run_procedure(bench, ONE_PASS).completed:
            found["as it is"].append(errors_of(bench))
            bench.run(StartProbeMountingCapture())
            bench.run(StartMapping())
            found["gauge plate"].append(errors_of(bench))
        bench.close()
    metrics: list[Metric] = []
    for way, errors in found.items():
        known = way == "gauge plate"
        metrics += over_seeds(
            f"outer map, same robot, {way}",
            [error for error, _ in errors],
            "mm",
            "lower",
            goal=GOAL_RMS_MM if known else None,
        )
        metrics += over_seeds(
            f"bias of the outer map, {way}",
            [abs(bias) for _, bias in errors],
            "mm",
            "lower",
            goal=GOAL_BIAS_MM if known else None,
        )
    return metrics


def errors_of(bench: Workbench) -> tuple[float | None, float]:
    """Return RMS and mean of the errors of the outer map in mm, for the same robot."""
    session = bench.session
    maps = session.results.maps
    if maps is None:
        return None, float("nan")
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    errors = outer_errors_mm(maps.value.outer.points_base(), truth, True)
    return rms(errors), float(np.mean(errors))
