"""Rolls of the RX90 on the sphere patch: time, memory, joint travel, which scenes are solved."""

import tracemalloc

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.reference.cheapest_constant_roll import cheapest_constant
from rona_core.robot.planning.plan_motion import PlanSettings, plan_scan
from rona_core.robot.redundancy.constant_roll import evaluate_constant_rolls, working_set_deg
from rona_core.robot.redundancy.margins import MarginLimits, solve_roll_grid
from rona_core.robot.redundancy.optimal_roll import RollProblem, optimal_roll
from rona_core.robot.redundancy.result import RollCost, RollCurve
from rona_core.robot.redundancy.variable_roll import plan_variable_roll, refine_roll
from tests.scenes.patch_scenes import N_ROLLS, SCENES, WayPoints, scene_model, scene_path

LONG_SCENES = ("S0", "S4")  # with 306 way-points
ROLLS_DEG = working_set_deg(N_ROLLS, 0.0, 360.0)
PLAIN = RollCost(evenness=0.0, limits=0.0, singularities=0.0, roll_deg_per_mm=360.0)
BARE = MarginLimits(singular_rad=1e-9, shoulder_mm=0.0)
DESCARTES = "Descartes (Tesseract), published run"
# joint travel in rad; CPU in s and memory in GB where they were taken (another machine)
TRAVEL_RAD: dict[tuple[str, WayPoints], float] = {
    ("S0", 90): 8.401,
    ("S4", 90): 17.009,
    ("S0", 306): 15.172,
    ("S4", 306): 29.762,
}
CPU_S = {"S0": 11.6, "S4": 3.7}
MEMORY_MB = {"S0": 5920.0, "S4": 2260.0}


def run(progress: Progress) -> list[Metric]:
    """Return the figures of constant and varying rolls."""
    progress("constant rolls")
    metrics = constant_metrics()
    for scene in LONG_SCENES:
        progress(f"varying roll on {scene}")
        metrics += varying_metrics(scene)
    progress("joint travel")
    metrics += travel_metrics()
    progress("six scenes")
    return metrics + scene_metrics()


def constant_metrics() -> list[Metric]:
    """Return the time to judge every roll of the longer path on every branch."""
    model, margin_limits = scene_model(), MarginLimits()
    metrics: list[Metric] = []
    for scene in LONG_SCENES:
        path = scene_path(scene, 306)
        took_s = 1e-3 * cpu_ms(
            lambda path=path: evaluate_constant_rolls(path, model, ROLLS_DEG, margin_limits)
        )
        name = f"{scene}: {len(path)} points, 72 rolls, 8 branches evaluation, CPU"
        metrics.append(Metric(name, took_s, "s", "lower", goal=0.4))
    return metrics


def varying_metrics(scene: str) -> list[Metric]:
    """Return time and memory of a varying roll, inverse kinematics and refinement included."""
    path, model = scene_path(scene, 306), scene_model()
    took_s = 1e-3 * cpu_ms(lambda: solve(scene))
    rolls_rad = np.deg2rad(ROLLS_DEG)
    problem = RollProblem(solve_roll_grid(path, model, rolls_rad, MarginLimits()), RollCost())
    rough = optimal_roll(problem)
    metrics = [
        Metric(f"{scene}: varying roll, CPU", took_s, "s", "lower", 0.6, DESCARTES, CPU_S[scene]),
        Metric(
            f"{scene}: varying roll, peak memory",
            peak_mb(scene),
            "MB",
            "lower",
            300.0,
            DESCARTES,
            MEMORY_MB[scene],
        ),
    ]
    if isinstance(rough, RollCurve):
        fine = refine_roll(problem, rough)
        share = fine.cost.total / rough.cost.total
        step_deg = float(np.rad2deg(np.abs(np.diff(fine.qs_rad, axis=0)).max()))
        metrics.append(
            Metric(f"{scene}: refined cost of that of the grid", share, "", "lower", 1.0)
        )
        metrics.append(Metric(f"{scene}: largest joint step, refined", step_deg, "deg", "lower"))
    return metrics


def travel_metrics() -> list[Metric]:
    """Return the joint travel with that as the only cost, and no singularity kept away from."""
    model, rolls_rad = scene_model(), np.deg2rad(ROLLS_DEG)
    metrics: list[Metric] = []
    for (scene, points), bar in TRAVEL_RAD.items():
        path = scene_path(scene, points)
        found = optimal_roll(RollProblem(solve_roll_grid(path, model, rolls_rad, BARE), PLAIN))
        value = found.cost.total if isinstance(found, RollCurve) else None
        name = f"{scene}-{points}: joint travel"
        metrics.append(Metric(name, value, "rad", "lower", bar, DESCARTES, bar))
    return metrics


def scene_metrics() -> list[Metric]:
    """Return how many scenes are certified or refused as they ought to be, and the cost won."""
    model, margin_limits, cost = scene_model(), MarginLimits(), RollCost()
    right, shares = 0, list[float]()
    for name, scene in SCENES.items():
        path = scene_path(name)
        plan = plan_scan(path, model, PlanSettings())
        wanted = "constant" if scene.feasible else "variable" if scene.variable else "none"
        right += plan.search.mode == wanted and plan.may_move == scene.variable
        evaluation = evaluate_constant_rolls(path, model, ROLLS_DEG, margin_limits)
        curve, _ = plan_variable_roll(evaluation.grid(), cost)
        constant = cheapest_constant(evaluation, cost)
        if curve is not None and constant is not None:
            shares.append(curve.cost.total / constant.cost.total)
    return [
        Metric("scenes certified or refused rightly, of six", right, "", "higher", goal=6),
        Metric("varying roll, cost of the cheapest constant one", max(shares), "", "lower", 1.0),
    ]


def solve(scene: str) -> object:
    """Find the varying roll of a scene of 306 way-points from its path alone."""
    rolls_rad = np.deg2rad(ROLLS_DEG)
    grid = solve_roll_grid(scene_path(scene, 306), scene_model(), rolls_rad, MarginLimits())
    problem = RollProblem(grid, RollCost())
    found = optimal_roll(problem)
    if isinstance(found, RollCurve):
        return refine_roll(problem, found)
    return found


def peak_mb(scene: str) -> float:
    """Return the most memory that the search holds at once, arrays included."""
    tracemalloc.start()
    solve(scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6
