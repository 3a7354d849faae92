"""Why sigmas of the maps tell no better where a map is wrong: their rank, step by step.

Rank is the correlation (Spearman) of the local sigma and the size of the local error of the cells
of a map. Normal errors with these sigmas have the highest; then errors of the patient itself,
shuffled among cells of a like sigma, with the shape that they have. The last is the best order that
was found in what the program observes, fitted to other patients. ``SEEDS`` and ``SKULL_SEEDS`` were
tuned with; ``OTHER_SEEDS`` were not, and have the order that is fitted to those. This explains, it
judges nothing, and no figure has a goal.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cases.patients import patients
from benchmarks.metric import Metric, Progress
from benchmarks.reference.map_coverage import parts, terms_of
from benchmarks.suites.accuracy.observed_cells import cell_observables
from benchmarks.suites.honesty.judged import over_draws, rank_correlation
from benchmarks.suites.ultrasound.observed_order import best_ranks, ranks_by_others
from rona_core.app.steps.maps.inputs import TERMS
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.truth import truth_of
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_core.session.specimen import SimulatedSkull

SEEDS = (*range(21_000, 21_024), *range(40_650, 40_695))
SKULL_SEEDS = (*range(10_000, 10_003), *range(37_200, 37_203))
OTHER_SEEDS = range(40_540, 40_648)  # formerly of the suite ``honesty``, never tuned with
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
QUANTITIES = ("outer_same_robot", "fused_same_robot", "inner", "inner_same_robot", "thickness")
CELLS = 400  # of a map that are looked at
LEAST_CELLS = 100  # that make a map
CLASSES = 6  # of the sigma, each with as many cells
NORMAL = "normal errors of these sigmas"
SHAPE = "its own errors, shuffled among like sigmas"
AS_IS = "as it is"
BEST = "best order of what is observed"


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells (n,) of a map of one session: local errors and sigmas in mm, and observables."""

    errors_mm: Floats
    sigmas_mm: Floats
    observed: Floats  # (n, k) logarithms, the first of the sigma
    bone: str  # whose it is: two sessions on one skull are of one patient
    skull: bool = False  # a real one


def run(progress: Progress) -> list[Metric]:
    """Return the mean rank correlation over sessions, step by step, for each map."""
    tuned = _looked_at(patients(progress, SEEDS, SKULL_SEEDS, FILES))
    others = _looked_at(patients(progress, OTHER_SEEDS))
    return [
        metric
        for name in QUANTITIES
        for metric in figures(name.replace("_", " "), tuned[name], others[name])
    ]


def _looked_at(sessions: Iterable[Session]) -> dict[str, list[Cells]]:
    """Return what is looked at of the maps of sessions, map by map."""
    found: dict[str, list[Cells]] = {name: [] for name in QUANTITIES}
    for session in sessions:
        for name, cells in cells_of(session):
            found[name].append(cells)
    return found


def cells_of(session: Session) -> Iterator[tuple[str, Cells]]:
    """Yield what is looked at of each map of a session with virtual devices."""
    made, terms = session.results.maps, TERMS.read(session)
    if made is None or terms is None or not made.value.inner.ok.any():
        return
    errors = cell_errors_mm(made.value, truth_of(session, build_virtual_rig(session.setup).scene))
    for name in QUANTITIES:
        known = np.isfinite(errors[name])
        if np.count_nonzero(known) < LEAST_CELLS:
            continue
        causes = terms_of(terms, name)
        found, sigmas = errors[name][known], parts(causes, known)[0]
        some = np.unique(np.linspace(0, len(found) - 1, CELLS).astype(np.int64))
        observed = cell_observables(session, causes, np.flatnonzero(known)[some])
        logs = np.column_stack((np.log(sigmas[some]), observed))
        specimen = session.setup.specimen
        skull = not isinstance(specimen, SimulatedSkull)
        bone = str(session.setup.seed) if isinstance(specimen, SimulatedSkull) else specimen.name
        yield name, Cells(found[some] - found.mean(), sigmas[some], logs, bone, skull)


def figures(name: str, tuned: Sequence[Cells], others: Sequence[Cells]) -> Iterator[Metric]:
    """Yield the figures of one map: of tuning patients, of those on skulls, and of others."""
    observed, errors = [one.observed for one in tuned], [one.errors_mm for one in tuned]
    best = best_ranks(observed, errors, [one.bone for one in tuned])
    apart = ranks_by_others(
        [one.observed for one in others], [one.errors_mm for one in others], observed, errors
    )
    for title, group, order in (
        ("", [one for one in tuned if not one.skull], _of(best, tuned, skull=False)),
        ("skulls, ", [one for one in tuned if one.skull], _of(best, tuned, skull=True)),
        ("others, ", others, apart),
    ):
        yield Metric(f"{name}, {title}sessions", float(len(group)), "", "higher")
        for step, ranks in {**steps(group), BEST: order}.items():
            yield Metric(f"{name}, {title}rank, {step}", over_draws(ranks).value, "", "higher")


def _of(ranks: Sequence[float], sessions: Sequence[Cells], *, skull: bool) -> list[float]:
    return [rank for rank, one in zip(ranks, sessions, strict=True) if one.skull is skull]


def steps(sessions: Sequence[Cells]) -> dict[str, list[float]]:
    """Return the rank correlation of each session, from errors as claimed to those that are."""
    random = np.random.default_rng(0)
    found: dict[str, list[float]] = {step: [] for step in (NORMAL, SHAPE, AS_IS)}
    for one in sessions:
        drawn = random.normal(size=len(one.sigmas_mm)) * one.sigmas_mm
        found[NORMAL].append(rank_correlation(drawn, one.sigmas_mm))
        found[SHAPE].append(rank_correlation(_shuffled(one, random), one.sigmas_mm))
        found[AS_IS].append(rank_correlation(one.errors_mm, one.sigmas_mm))
    return found


def _shuffled(one: Cells, random: np.random.Generator) -> Floats:
    """Return the errors (n,) with their ratios to sigma shuffled within classes of the sigma."""
    ratios = one.errors_mm / one.sigmas_mm
    order = np.argsort(one.sigmas_mm, kind="stable")
    for cells in np.array_split(order, CLASSES):
        ratios[cells] = random.permutation(ratios[cells])
    return ratios * one.sigmas_mm
