"""Beds of implants on virtual patients: is the stated probability that the limit holds honest?

Whole procedures of the realistic world: of the simulated skull with tracker, robot and pointer by
the balanced design, and of two real ones where they are there. On each patient beds are drawn, with
limits that ask for drawn levels of P, and searched for as step 10 does; both are held against the
true bone. Nothing was tuned on these seeds.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.cases.patients import patients
from benchmarks.metric import Metric, Progress
from benchmarks.suites.implant import patient_beds
from benchmarks.suites.implant.patient_beds import Patient, Search, Trial
from benchmarks.suites.implant.placement import interval
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.truth import truth_of
from rona_core.geometry.arrays import Bools, Floats, Ints

SEEDS = range(41_084, 41_192)
SKULL_SEEDS = range(38_059, 38_062)
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
BEDS = 12  # drawn on each patient
REQUIRED = 0.99
BINS = (0.0, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
RESAMPLES = 2000  # of patients


def run(progress: Progress) -> list[Metric]:
    """Return reliability of drawn beds, and what searches promise and keep."""
    trials: list[Trial] = []
    searches: list[Search] = []
    mapped = 0
    for patient in _patients(progress):
        generator = np.random.default_rng(patient.session.setup.seed)
        trials += patient_beds.drawn_beds(patient, generator, BEDS)
        searches += patient_beds.searched_beds(patient, generator, REQUIRED)
        mapped += 1
    return [
        Metric("patients with maps", float(mapped), "patients", "higher"),
        *reliability(trials),
        *searched(searches),
    ]


def _patients(progress: Progress) -> Iterator[Patient]:
    """Yield the patients that came to maps."""
    for number, session in enumerate(patients(progress, SEEDS, SKULL_SEEDS, FILES)):
        if session.results.maps is not None:
            truth = truth_of(session, build_virtual_rig(session.setup).scene)
            yield Patient(number, patient_beds.with_burr(session), truth)


def reliability(trials: Sequence[Trial]) -> Iterator[Metric]:
    """Yield mean predicted P of each bin beside the share that kept the limit.

    A bin holds where the prediction lies in the 95 % interval of that share, see `share_interval`.
    """
    predicted = np.array([one.probability for one in trials])
    kept = np.array([one.kept for one in trials], dtype=np.bool_)
    patients = np.array([one.patient for one in trials], dtype=np.int64)
    held = bins = 0
    for low, high in pairwise(BINS):
        inside = (predicted >= low) & ((predicted < high) | (high == BINS[-1]))
        if not inside.any():
            continue
        mean = float(predicted[inside].mean())
        least, most = share_interval(kept[inside], patients[inside])
        bins, held = bins + 1, held + (least <= mean <= most)
        title = f"drawn beds, P {low:g} to {high:g}, {int(inside.sum())}"
        yield Metric(f"{title}: predicted", mean, "share", "higher")
        yield Metric(f"{title}: observed", float(kept[inside].mean()), "share", "higher")
        yield Metric(f"{title}: observed, 95 % sure above", least, "share", "higher")
        yield Metric(f"{title}: observed, 95 % sure below", most, "share", "higher")
    share = held / bins if bins else None
    title = f"drawn beds, {len(trials)}: bins whose interval holds"
    yield Metric(title, share, "share", "higher", 1.0 if bins else None)
    yield from _residuals("drawn beds", trials)


def share_interval(kept: Bools, patients: Ints) -> tuple[float, float]:
    """Return where the share of beds (n,) that kept the limit lies, 95 %.

    Beds of one patient hang together, so whole patients are drawn with replacement (percentiles);
    where all or none kept it, that tells nothing. The wider end of this and of Clopper and Pearson.
    """
    least, most = interval(int(kept.sum()), len(kept))
    _, number = np.unique(patients, return_inverse=True)
    count, good = np.bincount(number), np.bincount(number, weights=kept)
    generator = np.random.default_rng(0)
    drawn = generator.integers(len(count), size=(RESAMPLES, len(count)))
    shares = good[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.percentile(shares, (2.5, 97.5)).tolist()
    return min(least, low), max(most, high)


def searched(searches: Sequence[Search]) -> Iterator[Metric]:
    """Yield how many searches found a safe bed, and how these and the refused ones turn out."""
    accepted = [one for one in searches if one.accepted]
    refused = [one for one in searches if not one.accepted]
    wanted = {(one.patient, one.implant) for one in searches}
    served = len({one.patient for one in accepted})
    title = f"P >= {REQUIRED:g} required"
    yield Metric(
        f"{title}, {len(wanted)} implants: accepted", float(len(accepted)), "beds", "higher"
    )
    yield Metric(f"{title}: patients with a bed", float(served), "patients", "higher")
    best = [one.best for one in accepted if one.best is not None]
    broken = sum(not one.kept for one in best)
    share = broken / len(best) if best else None
    goal = 1.0 - REQUIRED if best else None
    yield Metric(f"accepted beds, {len(best)}: violations", share, "share", "lower", goal)
    if best:
        most = interval(broken, len(best))[1]
        yield Metric("accepted beds: violations, 95 % sure below", most, "share", "lower")
    yield from _residuals("accepted beds", best)
    laid = [one.best for one in refused if one.best is not None]
    mean = float(np.mean([one.probability for one in laid])) if laid else None
    safe = sum(one.kept for one in laid) / len(laid) if laid else None
    nowhere = float(len(refused) - len(laid))
    yield Metric(f"refused, {len(refused)}: nowhere laid", nowhere, "beds", "lower")
    yield Metric(f"refused, {len(laid)} laid: predicted", mean, "share", "higher")
    yield Metric(f"refused, {len(laid)} laid: would have kept the limit", safe, "share", "lower")


def _residuals(title: str, trials: Sequence[Trial]) -> Iterator[Metric]:
    """Yield by how much the true bone left differs from what the map says, signed."""
    off: Floats = np.array([one.left_mm - one.predicted_mm for one in trials])
    if not len(off):
        return
    title = f"{title}: true less predicted residual"
    yield Metric(f"{title}, mean", float(off.mean()), "mm", "higher")
    yield Metric(f"{title}, 5 %", float(np.percentile(off, 5.0)), "mm", "higher")
