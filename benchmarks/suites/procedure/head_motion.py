"""The outer map while the head moves in its clamp: as it is, and led back by the marker on it.

One pass of the whole procedure with virtual devices over seeds: in a nominal world but for a head
that creeps by up to 0.3 mm and breathes by 0.03 mm; in the nominal, the realistic and the hard
world. "As it is" maps the same captures without the marker. Errors are those for the same robot,
and hold where the head lay in step 4.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.metric import Metric, Progress, over_seeds
from rona_core.app.declarations.figures import limit_of
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.references import watch_head
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.runtime.handling import derive, derive_all
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.view import head_figures
from rona_core.app.steps.setup.messages import SetSeed, SetWorld
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.compose import build_virtual_rig, new_workbench
from rona_core.evaluation.map_metrics import cells, outer_errors_mm
from rona_core.evaluation.scan_metrics import head_shift_figures
from rona_core.evaluation.truth import rms, truth_of
from rona_core.session.document import Derived, Session

SEEDS = range(34_000, 34_012)
WORLDS = {
    "drift 0.3 mm": SetWorld(profile="nominal", head_drift_mm=0.3, breathing_mm=0.03),
    "nominal": SetWorld(profile="nominal"),
    "realistic": SetWorld(profile="realistic"),
    "hard": SetWorld(profile="hard"),
}
ONE_PASS = stages("caliper", skip=("tilts", "tilted"))
GOAL_COMMON_MM, GOAL_ALARMS = limit_of("head_shift_error_mm"), 0.05


@dataclass(frozen=True, slots=True)
class HeadRun:
    """What one run of the procedure gave; lengths in mm."""

    rms_mm: tuple[float | None, float | None]  # of the outer map: as it is, led back
    bias_mm: tuple[float, float]
    seen_mm: float  # shift from step 4 to the scan, as the marker shows it
    error_mm: float  # of it, 3D
    sigma_mm: float  # predicted, 3D
    moved: bool
    flagged: bool


def run(progress: Progress) -> list[Metric]:
    """Return errors of the outer map and of the shift, false alarms and flags."""
    metrics: list[Metric] = []
    for name, world in WORLDS.items():
        found: list[HeadRun] = []
        for seed in SEEDS:
            progress(f"{name}, seed {seed}")
            made = run_of(seed, world)
            if made is not None:
                found.append(made)
        metrics += _metrics(name, found)
    return metrics


def run_of(seed: int, world: SetWorld) -> HeadRun | None:
    """Return what one seed gives; None where the procedure does not end."""
    bench = new_workbench(Session(name=f"head, seed {seed}"))
    bench.dispatch(SetSeed(seed))
    bench.dispatch(world)
    completed = run_procedure(bench, ONE_PASS).completed
    session = bench.session
    bench.close()
    watch = watch_head(session, session.captures.scan)
    if not completed or watch is None:
        return None
    seen = head_figures(session)
    error = head_shift_figures(session, truth_of(session, build_virtual_rig(session.setup).scene))
    rows = quality_rows(seen, session)
    errors = [outer_errors(made) for made in (as_it_is(session), session)]
    return HeadRun(
        rms_mm=(rms(errors[0]), rms(errors[1])),
        bias_mm=(float(errors[0].mean()), float(errors[1].mean())),
        seen_mm=seen.get("head_shift_mm", np.nan),
        error_mm=float(error.get("head_shift_error_mm") or np.nan),
        sigma_mm=seen.get("head_shift_sigma_mm", np.nan),
        moved=watch.state == "moved",
        flagged=any(r.key == "head_motion_mm" and r.verdict in ("review", "fail") for r in rows),
    )


def as_it_is(session: Session) -> Session:
    """Return the session with cloud and maps of the same captures, but without the marker."""
    held = session.captures
    captures = replace(
        held,
        surface=tuple(replace(stroke, head=None) for stroke in held.surface),
        scan=None if held.scan is None else replace(held.scan, head=None),
    )
    bare = replace(session, captures=captures)
    results: dict[str, object] = {
        "surface": derive(REGISTRY.result("surface"), bare, BuildSurface())
    }
    for name in ("surface", "detection", "second_detection", "maps"):
        if name not in results:
            results |= derive_all(bare, StartMapping())
        value = results[name]
        made = None if value is None else Derived(value, StartMapping.__name__, {}, {})
        bare = bare.with_result(name, made)
    return bare


def outer_errors(session: Session) -> np.typing.NDArray[np.float64]:
    """Return the errors (n,) of the outer map in mm, for the same robot."""
    maps = session.results.maps
    if maps is None:
        return np.full(1, np.nan)
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    return outer_errors_mm(cells(maps.value.outer), truth, True)


def _metrics(name: str, found: list[HeadRun]) -> list[Metric]:
    metrics: list[Metric] = []
    for k, way in enumerate(("as it is", "led back")):
        metrics += over_seeds(
            f"{name}: outer map, same robot, {way}", [r.rms_mm[k] for r in found], "mm", "lower"
        )
        metrics += over_seeds(
            f"{name}: bias of the outer map, {way}",
            [abs(r.bias_mm[k]) for r in found],
            "mm",
            "lower",
            goal=GOAL_COMMON_MM if name == "drift 0.3 mm" and way == "led back" else None,
        )
    metrics += over_seeds(f"{name}: shift seen", [r.seen_mm for r in found], "mm", "lower")
    metrics += over_seeds(
        f"{name}: error of the shift, 3D",
        [r.error_mm for r in found],
        "mm",
        "lower",
        goal=GOAL_COMMON_MM,
    )
    ratio = rms(np.array([r.error_mm / r.sigma_mm for r in found]))
    metrics.append(Metric(f"{name}: error over its prediction, RMS", ratio, "", "lower"))
    share = float(np.mean([r.moved for r in found])) if found else None
    goal = GOAL_ALARMS if name == "nominal" else None
    metrics.append(Metric(f"{name}: scans with a head that moved", share, "", "lower", goal))
    flagged = float(np.mean([r.flagged for r in found])) if found else None
    metrics.append(Metric(f"{name}: scans flagged", flagged, "", "lower"))
    return metrics
