"""Bands of the maps: how often is the truth within 1.96 of the standard deviations they state?

The whole procedure over seeds (``--seeds 8`` takes so many). Of each map: the share of cells whose
error lies in the band, pooled and of the worst and best seed; then of the part that all cells of a
map share (its mean, one for each seed), and of the rest (less that mean, within what each cell
states for itself). A band that is wide everywhere holds all of it and tells nothing: the rank
correlation of stated and true deviation says how far it knows where the map is bad.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from benchmarks.metric import Metric, Progress
from benchmarks.reference.map_coverage import Band, bands, within
from rona_core.compose import run_demo
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_core.session.files import load_session

SEEDS = range(42000, 42003)  # nothing was adjusted with these
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
LEAST, MOST = 0.85, 0.99  # share that a band of 95 % shall hold
HELD = ("thickness", "inner", "inner_same_robot")  # those that shall


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


def ranks(errors: Floats, sigma: Floats) -> float:
    """Return Spearman's correlation between the size of errors and what was stated, both (n,)."""
    return float(np.asarray(spearmanr(np.abs(errors), sigma))[0])


def rms(values: Floats) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
