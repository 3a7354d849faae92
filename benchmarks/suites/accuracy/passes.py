"""The scan with the probe tilted: what it covers, what it gets wrong, and how honest it is.

The whole procedure with virtual devices up to the implant bed, over patients of the realistic
world. With the seeds nothing was tuned.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.procedure import stages
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.compose import build_virtual_rig, evaluate_virtual, run_demo
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.scan_metrics import detected_passes, true_probe_poses
from rona_core.evaluation.truth import truth_of
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.session.document import Session
from rona_core.session.files import load_session

SEEDS = range(64_100, 64_200)
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
TO_BED = stages("implant")
# least coverage of the inner map -> share of patients that have it
COVERAGE_GOALS = {0.95: 0.95, 0.8: 0.99}
BED_GOAL = 0.9
# A-scans in the inner map that are more than so many mm off: in nearly all patients, and in any
OFF_MM = (0.5, 1.0)
FEW, MOST = (0.04, 0.005), (0.11, 0.02)
FEW_GOALS = (0.9, 0.95)
RATIO_GOAL = 1.4
RMS_MM = ("surface_rms_mm", "outer_rms_mm", "inner_rms_mm", "thickness_rms_mm")


@dataclass(frozen=True, slots=True)
class PassFigures:
    """What the passes over one patient gave; None where the procedure ended before its maps."""

    coverage: float  # of the inner map: share of the cells of the outer one
    one_pass_coverage: float  # share of the region
    off: tuple[float, ...]  # share of the A-scans in the inner map, for each of ``OFF_MM``
    ratio: float  # mean squared error of the thickness over its stated variance
    bed: bool
    rms_mm: Mapping[str, float]  # errors of the whole procedure, by figure


def run(progress: Progress) -> list[Metric]:
    """Return shares of patients, shares of A-scans, and the squared error over its variance."""
    return list(metrics([pass_figures(*made) for made in _sessions(progress)]))


def _sessions(progress: Progress) -> Iterator[tuple[Session, Mapping[str, object]]]:
    for seed in SEEDS:
        progress(f"seed {seed}")
        yield run_demo(seed, among=TO_BED)
    for path in FILES:
        progress(path.name)
        session = load_session(path)
        yield session, evaluate_virtual(session, build_virtual_rig(session.setup))


def pass_figures(session: Session, figures: Mapping[str, object]) -> PassFigures | None:
    """Return the figures of one patient; None without maps."""
    made, accuracy = session.results.maps, map_accuracy(session)
    if made is None or accuracy is None:
        return None
    counted_mm = scan_errors(session)[made.value.inner_used]
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    thickness_mm = cell_errors_mm(made.value, truth)["thickness"]
    sigma = accuracy.thickness
    variance = sigma.whole_own_mm() ** 2 + sigma.shared_mm**2
    known = np.isfinite(thickness_mm)
    return PassFigures(
        coverage=made.value.inner_share,
        one_pass_coverage=_number(figures["inner_coverage_one_pass_fraction"]),
        off=_shares_off(counted_mm),
        ratio=float(np.mean((thickness_mm**2 / variance)[known])),
        bed=judge_part("bed", session).holds,
        rms_mm={key: _number(figures[key]) for key in RMS_MM},
    )


def scan_errors(session: Session) -> Floats:
    """Return errors (n,) of the thickness along the axis in all passes.

    An error is infinite where there is no inner boundary. All A-scans of the first pass come first.
    """
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    errors = [np.zeros(0)]
    for found, scans in detected_passes(session):
        poses = Poses.joined([true_probe_poses(scan, truth) for scan in scans])
        off_mm = found.thickness_mm - truth.thickness_below_mm(poses)
        errors.append(np.where(np.isfinite(off_mm), off_mm, np.inf))
    return np.concatenate(errors)


def metrics(found: Sequence[PassFigures | None]) -> Iterator[Metric]:
    """Yield shares of all patients, and medians of those with maps."""
    known = [one for one in found if one is not None]
    count = max(len(found), 1)
    yield Metric(f"patients without maps, of {len(found)}", count - len(known), "", "lower")
    for least, goal in COVERAGE_GOALS.items():
        share = sum(one.coverage >= least for one in known) / count
        name = f"patients with at least {least:g} of the inner map"
        yield Metric(name, share, "share", "higher", goal)
    bed = sum(one.bed for one in known) / count
    yield Metric("patients with an implant bed", bed, "share", "higher", BED_GOAL)
    if not known:
        return
    for k, off_mm in enumerate(OFF_MM):
        shares = [one.off[k] for one in known]
        title = f"A-scans in the inner map off by more than {off_mm:g} mm"
        few = sum(share <= FEW[k] for share in shares) / count
        name = f"patients with at most {100 * FEW[k]:g} % {title}"
        yield Metric(name, few, "share", "higher", FEW_GOALS[k])
        yield Metric(f"{title}, largest share of a patient", max(shares), "share", "lower", MOST[k])
        yield Metric(f"{title}, mean", float(np.mean(shares)), "share", "lower")
    for name, values in (
        ("coverage of the inner map", [one.coverage for one in known]),
        ("coverage of the first pass alone", [one.one_pass_coverage for one in known]),
    ):
        yield Metric(f"{name}, median", float(np.median(values)), "share", "higher")
    for key in RMS_MM:
        errors_mm = [one.rms_mm[key] for one in known]
        yield Metric(f"{key}, median", float(np.median(errors_mm)), "mm", "lower")
        yield Metric(f"{key}, worst", max(errors_mm), "mm", "lower")
    ratio = float(np.mean([one.ratio for one in known]))
    yield Metric("thickness, squared error over variance", ratio, "1", "lower", RATIO_GOAL)


def _shares_off(errors_mm: Floats) -> tuple[float, ...]:
    """Return the share of errors (n,) above each of ``OFF_MM``."""
    return tuple(
        float(np.mean(np.abs(errors_mm) > off_mm)) if len(errors_mm) else 0.0 for off_mm in OFF_MM
    )


def _number(value: object) -> float:
    """Return a figure that may be missing; 0.0 for none."""
    return float(value) if isinstance(value, int | float) else 0.0
