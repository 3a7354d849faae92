"""Bands of the maps: how often is the truth within 1.96 of the standard deviations they state?

The whole procedure over seeds (``--seeds 8`` takes so many). Of each map: the share of cells whose
error lies in the band, pooled and of the worst and best seed; then of the part that all cells of a
map share (its mean, one for each seed), and of the rest (less that mean, within what each cell
states for itself). A band that is wide everywhere holds all of it and tells nothing: the rank
correlation of stated and true deviation says how far it knows where the map is bad.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from benchmarks.metric import Metric, Progress
from rona_core.app.steps.maps.map_accuracy import MapAccuracy, map_accuracy
from rona_core.compose import build_virtual_rig, run_demo
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_core.session.files import load_session

SEEDS = range(42000, 42003)  # nothing was adjusted with these
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
BAND = 1.96  # standard deviations: 95 % of a normal error
LEAST, MOST = 0.85, 0.99  # share that a band of 95 % shall hold
HELD = ("thickness", "inner", "inner_same_robot")  # those that shall


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Errors (n,) of the cells of one map in mm, and what the program states."""

    errors_mm: Floats
    total_mm: Floats  # (n,)
    own_mm: Floats  # (n,) what each cell has of its own
    shared_mm: float  # RMS over the cells of what all share


def run(progress: Progress) -> list[Metric]:
    """Return the coverage of every map over all seeds."""
    found: dict[str, list[Band]] = {}
    for session in sessions(progress):
        for name, band in bands(session):
            found.setdefault(name, []).append(band)
    return [metric for name, parts in found.items() for metric in figures(name, parts)]


def sessions(progress: Progress) -> Iterator[Session]:
    """Yield the session of every seed and of every file."""
    for seed in SEEDS:
        progress(f"seed {seed}")
        yield run_demo(seed)[0]
    for path in FILES:
        progress(path.name)
        yield load_session(path)


def bands(session: Session) -> Iterator[tuple[str, Band]]:
    """Yield every map of a session with virtual devices, absolute and for the same robot."""
    made, accuracy = session.results.maps, map_accuracy(session)
    if made is None or accuracy is None:
        return
    truth = Truth(build_virtual_rig(session.setup).scene)
    for name, errors in cell_errors_mm(made.value, truth).items():
        total, own, shared = _stated(accuracy, name)
        known = np.isfinite(errors)
        if known.any():
            rms = float(np.sqrt(np.mean(shared[known] ** 2)))
            yield name, Band(errors[known], total[known], own[known], rms)


def _stated(accuracy: MapAccuracy, name: str) -> tuple[Floats, Floats, Floats]:
    """Return the standard deviations (nu, nv): all parts, each cell's own, what all share."""
    same = name.endswith("_same_robot")
    part = getattr(accuracy, name.removesuffix("_same_robot"))
    total = part.same_robot_mm() if same else part.total_mm()
    shared = part.speed_mm if same else np.hypot(part.speed_mm, part.pose_mm)
    return total, part.own_mm, shared


def figures(name: str, parts: list[Band]) -> list[Metric]:
    """Return size, coverage and rank correlation of one map over its seeds."""
    errors = np.concatenate([part.errors_mm for part in parts])
    total = np.concatenate([part.total_mm for part in parts])
    own = np.concatenate([part.own_mm for part in parts])
    means = np.array([part.errors_mm.mean() for part in parts])
    rest = np.concatenate([part.errors_mm - part.errors_mm.mean() for part in parts])
    shared = np.array([part.shared_mm for part in parts])
    seeds = [within(part.errors_mm, part.total_mm) for part in parts]
    least, most = (LEAST, MOST) if name in HELD else (None, None)
    pooled = within(errors, total)
    metrics = [
        Metric(f"{name}: within the band", pooled, "share", "higher", least),
        Metric(f"{name}: the same, not too wide", pooled, "share", "lower", most),
        Metric(f"{name}: least of {len(parts)} seeds", min(seeds), "share", "higher", least),
        Metric(f"{name}: most of {len(parts)} seeds", max(seeds), "share", "lower"),
        Metric(f"{name}: RMS error", rms(errors), "mm", "lower"),
        Metric(f"{name}: RMS stated", rms(total), "mm", "lower"),
        Metric(f"{name}, own part: within the band", within(rest, own), "share", "higher"),
        Metric(f"{name}, own part: RMS error", rms(rest), "mm", "lower"),
        Metric(f"{name}, own part: RMS stated", rms(own), "mm", "lower"),
        Metric(f"{name}: rank correlation, stated and true", ranks(errors, total), "1", "higher"),
        Metric(f"{name}, own part: rank correlation", ranks(rest, own), "1", "higher"),
    ]
    if shared.any():
        of = f"{name}, shared part"
        metrics += [
            Metric(f"{of}: within the band", within(means, shared), "share", "higher"),
            Metric(f"{of}: RMS error", rms(means), "mm", "lower"),
            Metric(f"{of}: RMS stated", rms(shared), "mm", "lower"),
        ]
    return metrics


def within(errors: Floats, sigma: Floats) -> float:
    """Return the share of errors (n,) that lie in their bands."""
    return float(np.mean(np.abs(errors) <= BAND * sigma))


def ranks(errors: Floats, sigma: Floats) -> float:
    """Return Spearman's correlation between the size of errors and what was stated, both (n,)."""
    return float(np.asarray(spearmanr(np.abs(errors), sigma))[0])


def rms(values: Floats) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
