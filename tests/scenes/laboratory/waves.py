"""Waves of a laboratory's recording: pulses, their way through a plate, the field of a probe.

Pulses are made as hardware makes them: an excitation drives resonators twice.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0, j1

from rona_core.geometry.arrays import Floats
from tests.scenes.laboratory.bench import WATER_SPEED, Bench, Hit

Complexes = NDArray[np.complex128]


def copy_of(bench: Bench, f: Floats, water_us: Floats, way_mm: Floats) -> Complexes:
    """Return what delay, loss and spreading do to a pulse: (n, f)."""
    matter = bench.matter
    loss = matter.loss_db_per_cm / 86.859
    y, f0 = matter.power, bench.hit.centre_mhz
    safe = np.maximum(f, 1e-4)
    if abs(y - 1.0) < 1e-6:
        slower = -loss / np.pi**2 * np.log(safe / f0)
    else:
        slower = loss * np.tan(0.5 * np.pi * y) / (2.0 * np.pi) * (safe ** (y - 1) - f0 ** (y - 1))
    slower = np.clip(slower, -0.05, 0.05)
    delay = water_us[:, None] + way_mm[:, None] * (1.0 / matter.speed + slower)
    depth = float(np.mean(water_us)) * WATER_SPEED + float(np.mean(way_mm)) * matter.speed / 1.483
    phase = np.exp(-2j * np.pi * f * delay - loss * safe**y * way_mm[:, None])
    return phase * piston(bench, f, max(depth + bench.start_us * WATER_SPEED, 0.0))


def piston(bench: Bench, f: Floats, path_mm: float) -> Complexes:
    """Return what a round piston hears of a mirror at half of this path."""
    ratio = path_mm * WATER_SPEED / np.maximum(f, 1e-3) / bench.radius_mm**2
    x = 2.0 * np.pi / np.maximum(ratio, 1e-6)
    return 1.0 - np.exp(-1j * x) * (j0(x) + 1j * j1(x))


def pulse_of(hit: Hit, f: Floats) -> Complexes:
    """Return the spectrum (f,) of a pulse."""
    f0 = hit.centre_mhz
    w = 2.0 * np.pi * f
    if hit.kind == "spike":
        drive = 1.0 / (1.0 + 1j * w * 0.1 / f0)
    elif hit.kind == "square":
        drive = np.sinc(0.5 * f / f0) * np.exp(-0.25j * w / f0)
    else:
        length = hit.cycles / f0
        t = np.arange(0.0, length, 0.02 / f0)
        sweep = 0.6 * f0 if hit.kind == "chirp" else 0.0
        phase = 2.0 * np.pi * ((f0 - 0.5 * sweep) * t + 0.5 * sweep / length * t**2)
        wave = np.sin(phase) * np.minimum(1.0, 8.0 * np.minimum(t, length - t) / length)
        drive = np.array([(wave * np.exp(-1j * one * t)).sum() for one in w]) * 0.02 / f0
    for over, quality in hit.resonances:
        x = f / (over * f0)
        drive = drive * (1j * x / quality / (1.0 - x**2 + 1j * x / quality)) ** 2
    ghost = 1.0 + hit.ghost * np.exp(-1j * w * hit.ghost_cycles / f0)
    return np.asarray(drive * ghost * np.exp(1j * hit.turn * np.sign(f)), dtype=np.complex128)


def bang_of(bench: Bench, m: int, rng: np.random.Generator) -> Floats:
    """Return what is left of the emission, nearly the same in every scan."""
    t = bench.start_us + np.arange(m) / bench.sampling_mhz
    after = np.maximum(t, 0.0)
    wave = np.zeros(m)
    for over in (0.25, 0.9, 1.15):
        wave += np.cos(2.0 * np.pi * over * bench.hit.centre_mhz * after + rng.uniform(0, 6.28))
    wave = bench.bang * wave * np.exp(-after / bench.bang_us) * (t >= 0)
    return wave * np.exp(0.01 * rng.standard_normal((bench.scans, 1)))
