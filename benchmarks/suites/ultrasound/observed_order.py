"""Order of A-scans, or of places, by how wrong they may be, fitted to the errors of other patients.

Ridge regression of the logarithm of the error on logarithms of what the program observes, and
their squares, all less their median in the patient: only the order within a patient matters.
"""

from collections.abc import Sequence

import numpy as np

from benchmarks.suites.honesty.judged import rank_correlation
from benchmarks.suites.honesty.thickness import Patient
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.spatial.neighbours import plane_axes

FOLDS = 5  # of patients
PENALTY = 0.03  # of the ridge, for one A-scan and features of variance 1
FLOOR_MM = 0.01  # added to sizes of errors, whose logarithm is fitted
LEAST = 1e-5  # of what a logarithm is taken of
AROUND = 20  # neighbours of a place: those within 5 mm


def best_ranks(
    observed: Sequence[Floats], errors_mm: Sequence[Floats], bones: Sequence[str] | None = None
) -> list[float]:
    """Return the rank correlation of each session with the order fitted to other patients.

    Args:
        observed: Logarithms (n, k) of what is observed at places, one array a session.
        errors_mm: Theirs (n,).
        bones: Whose bone each session is of; by default each has a patient of its own.
    """
    ranks = np.full(len(observed), np.nan)
    patient = np.arange(len(observed))
    if bones is not None:
        patient = np.array([sorted(set(bones)).index(bone) for bone in bones], dtype=np.int64)
    order = np.random.default_rng(0).permutation(patient.max(initial=-1) + 1)
    for some in np.array_split(order, FOLDS):
        held = np.flatnonzero(np.isin(patient, some)).tolist()
        rest = np.setdiff1d(np.arange(len(observed)), held).tolist()
        ranks[held] = ranks_by_others(
            [observed[i] for i in held],
            [errors_mm[i] for i in held],
            [observed[i] for i in rest],
            [errors_mm[i] for i in rest],
        )
    return [float(rank) for rank in ranks]


def ranks_by_others(
    observed: Sequence[Floats],
    errors_mm: Sequence[Floats],
    others: Sequence[Floats],
    their_errors_mm: Sequence[Floats],
) -> list[float]:
    """Return the rank correlation of each session with the order fitted to other sessions.

    Args:
        observed: Logarithms (n, k) of what is observed at places, one array a session.
        errors_mm: Theirs (n,).
        others: The same of the sessions that are fitted to; without any there is no order.
        their_errors_mm: Theirs (n,).
    """
    if not others:
        return [float("nan")] * len(observed)
    weights = ridge([_features(logs) for logs in others], their_errors_mm)
    return [
        rank_correlation(errors, _features(logs) @ weights)
        for logs, errors in zip(observed, errors_mm, strict=True)
    ]


def ridge(inputs: Sequence[Floats], errors_mm: Sequence[Floats]) -> Floats:
    """Return weights (k,) of features (n, k) that tell large errors (n,) from small ones.

    Within each patient; one of four times as many A-scans counts twice as much.
    """
    x = np.concatenate([f - f.mean(axis=0) for f in inputs])
    logs = [np.log(np.abs(errors) + FLOOR_MM) for errors in errors_mm]
    y = np.concatenate([log - log.mean() for log in logs])
    counts = np.concatenate([np.full(len(log), len(log) ** -0.5) for log in logs])
    scale = np.maximum(x.std(axis=0), LEAST)
    x = x / scale
    squares = (x.T * counts) @ x
    penalty = PENALTY * counts.sum() * np.eye(len(squares))
    return np.linalg.solve(squares + penalty, (x.T * counts) @ y) / scale


def observables(patient: Patient, rows: Ints, local_sigma_mm: Floats) -> Floats:
    """Return logarithms (n, k) of what the program observes of some A-scans (n,)."""
    found = patient.detection
    timing_mm, depth_mm = found.thickness_sigma_mm[rows], found.thickness_mm[rows]
    around = surroundings(patient.places_base, found.thickness_mm, found.inner_ok, rows)
    columns = [
        local_sigma_mm,
        np.sqrt(np.maximum(local_sigma_mm**2 - timing_mm**2, 0.0)),  # of the speed of the place
        timing_mm,
        depth_mm,
        found.outer_quality[rows],  # level of the front echo
        1.0 - found.inner_quality[rows],
        found.alternative_quality[rows],
        *around.T,
    ]
    return np.log(np.maximum(np.stack(columns, axis=1), LEAST))


def surroundings(places: Floats, thickness_mm: Floats, ok: Bools, rows: Ints) -> Floats:
    """Return slope and scatter (mm) of the sure ones around, and the share of silent ones (n, 3).

    Args:
        places: Of all A-scans (m, 3), in mm.
        thickness_mm: Theirs (m,), a guess where it is not ok.
        ok: Which of them are sure (m,).
        rows: Those asked for (n,).
    """
    flat = (places - places.mean(axis=0)) @ plane_axes(places)[:, :2]
    sure = np.flatnonzero(ok)
    found = np.zeros((len(rows), 3))
    for i, row in enumerate(rows):
        away = flat - flat[row]
        apart = np.hypot(*away.T)
        near = sure[np.argsort(apart[sure])][1 : AROUND + 1]
        plane = np.column_stack([np.ones(len(near)), away[near]])
        fit = np.linalg.lstsq(plane, thickness_mm[near], rcond=None)[0]
        rest = thickness_mm[near] - plane @ fit
        silent = ~ok[np.argsort(apart)[1 : AROUND + 1]]
        found[i] = np.hypot(*fit[1:]), rest.std(), silent.mean()
    return found


def _features(observed: Floats) -> Floats:
    """Return observables (n, k) less their median in the patient, and the squares of that."""
    less = observed - np.median(observed, axis=0)
    return np.hstack([less, less**2])
