"""The recorder of a laboratory: noise, drift, hum, spikes, converter, and scans that went wrong."""

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Bools, Floats
from tests.scenes.laboratory.bench import Bench


def faulty(bench: Bench, rf: Floats, rng: np.random.Generator) -> Floats:
    """Return lines (n, samples) with noise, drift, hum and spikes."""
    n, m = rf.shape
    t = np.arange(m) / bench.sampling_mhz
    rf = rf + bench.noise * rng.standard_normal((n, m))
    sway = rng.standard_normal((n, 1)) * np.sin(2 * np.pi * (t / 70.0 + rng.random((n, 1))))
    rf += bench.offset + bench.slow * (sway + np.exp(-t / 15.0))
    rf += bench.hum * np.sin(2 * np.pi * (1.37 * bench.hit.centre_mhz * t + rng.random((n, 1))))
    for row in range(n):
        for at in rng.integers(0, m, rng.poisson(bench.spikes)):
            rf[row, at : at + 2] += rng.normal(0.0, 0.8)
    return rf


def step_of(bench: Bench) -> float:
    """Return the step of the converter, 0 for one without steps."""
    return 0.0 if bench.bits is None else bench.full_scale / 2.0 ** (bench.bits - 1)


def written(
    bench: Bench, rf: Floats, rng: np.random.Generator
) -> tuple[Floats, NDArray[np.int64], Bools]:
    """Return what is written, of which scan each line is (n,), and which are spoilt (n,)."""
    n = len(rf)
    order = np.arange(n)
    twice = np.flatnonzero(rng.random(n) < bench.doubled)
    order[twice] = np.maximum(twice - 1, 0)  # the line before was written again
    rf = np.clip(rf, -bench.full_scale, bench.full_scale)
    if bench.bits is not None:
        rf = np.rint(rf / step_of(bench))
        rf = np.clip(rf, -(2.0 ** (bench.bits - 1)), 2.0 ** (bench.bits - 1) - 1)
    top = float(rf.max())
    dead = rng.random(n) < bench.dead
    full = rng.random(n) < bench.saturated
    rf = rf[order]
    rf[dead], rf[full] = 0.0, top
    return rf, order, dead | full
