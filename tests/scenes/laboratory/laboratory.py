"""Pulse-echo recordings of plates as laboratories make them, with the truth about each scan.

Every arrival is a copy of one pulse, delayed, damped with the dispersion that belongs to the
damping, and spread by the field of a round piston. Nothing of the program's own models is used.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats
from tests.scenes.laboratory.bench import WATER, WATER_SPEED, Bench, Hit, Matter
from tests.scenes.laboratory.recorder import faulty, step_of, written
from tests.scenes.laboratory.waves import bang_of, copy_of, piston, pulse_of

FAINTEST = 1e-4  # arrivals below it over a perfect mirror are left out
AUDIBLE = 4.0  # the back wall's peak over the rms of noise and quantising


@dataclass(frozen=True, slots=True, eq=False)
class Laboratory:
    """A recording and the truth about it."""

    file: RecordedRf
    thickness_mm: Floats
    whole: Bools  # scans with an echo of the back wall in them
    audible: bool  # whether that echo stands above the noise at all
    speed: float


def laboratory(bench: Bench, rng: np.random.Generator) -> Laboratory:
    """Return what the recorder of this bench writes."""
    n, m = bench.scans, round(bench.length_us * bench.sampling_mhz)
    place = _places(bench, rng)
    across = place - place.min(axis=0)
    along = across[:, 0] / max(float(across[:, 0].max()), 1e-9) - 0.5
    thickness = bench.thickness_mm + bench.wedge_mm * along + bench.waves_mm * _waves(place, rng)
    standoff = bench.standoff_us + bench.standoff_wedge_us * along
    standoff = standoff + bench.standoff_sd_us * rng.standard_normal(n)
    size = 3 * m
    f: Floats = np.fft.rfftfreq(size, 1.0 / bench.sampling_mhz).astype(np.float64)
    pulse = pulse_of(bench.hit, f)
    level = np.exp(0.05 * rng.standard_normal(n))
    back = np.exp(bench.back_spread * rng.standard_normal(n))
    lift = rng.random(n) < bench.lifted
    scale = float(np.abs(np.fft.irfft(pulse * piston(bench, f, 0.0), size)).max())
    used = np.abs(pulse) > 1e-5 * np.abs(pulse).max()
    spectrum = np.zeros((n, len(f)), dtype=np.complex128)
    wall = np.zeros((1, len(f)), dtype=np.complex128)
    first = 1.0
    trips = 2 if bench.coupling == "contact" else 1  # two echoes are needed, or a front and one
    for number, (height, waters, plates, gaps) in enumerate(_arrivals(bench)):
        gain = height * level * (back**plates)
        water = waters * standoff + gaps * 2.0 * (bench.floor_gap_mm or 0.0) / WATER_SPEED
        way = 2.0 * plates * thickness
        if (
            float(np.median(water))
            - bench.start_us
            + 2.0 * plates * bench.thickness_mm / (bench.matter.speed)
            > 2.0 * bench.length_us
        ):
            continue  # after the record
        copy = copy_of(bench, f[used], water - bench.start_us, way)
        spectrum[:, used] += gain[:, None] * copy
        if (plates, gaps, waters <= 1) == (trips, 0, True):
            wall[0, used] += (height * copy[:1])[0]
        if number == 0:
            first = abs(height)
    rf = np.fft.irfft(spectrum * pulse, size, axis=1)[:, :m] / (scale * first)
    heard = float(np.abs(np.fft.irfft(wall * pulse, size)[0, :m]).max()) / (scale * first)
    rf[lift] = 0.0
    rf += bang_of(bench, m, rng)
    rf = faulty(bench, rf, rng)
    floor = float(np.hypot(bench.noise, step_of(bench) / np.sqrt(12.0)))
    rf, order, spoilt = written(bench, rf, rng)
    positions = None if bench.layout == "none" else place[:, : bench.columns]
    file = RecordedRf(
        "laboratory.npz",
        rf,
        bench.sampling_mhz,
        bench.start_us if bench.start_known else 0.0,
        bench.start_known,
        positions,
    )
    return Laboratory(
        file,
        thickness[order],
        ~lift[order] & ~spoilt,
        heard > AUDIBLE * floor,
        bench.matter.speed,
    )


def _places(bench: Bench, rng: np.random.Generator) -> Floats:
    n = bench.scans
    if bench.layout == "scatter":
        return np.column_stack((rng.uniform(-20, 20, (n, 2)), rng.normal(0, 0.1, n)))
    index = np.arange(n, dtype=np.float64)
    zero = np.zeros(n)
    if bench.layout != "raster":
        return np.column_stack((0.5 * index, zero, zero))
    side = max(1, int(np.ceil(np.sqrt(n))))
    return np.column_stack((1.5 * (index % side), 1.5 * (index // side), zero))


def _waves(place: Floats, rng: np.random.Generator) -> Floats:
    total = np.zeros(len(place))
    for _ in range(9):
        total += np.sin(place[:, :2] @ rng.normal(0.0, 0.16, 2) + rng.uniform(0.0, 6.28))
    return total * np.sqrt(2.0) / 3.0


def _arrivals(bench: Bench) -> list[tuple[float, int, int, int]]:
    """Return height, passes of the stand-off, of the plate, and of the gap behind it."""
    inside, water = bench.matter.impedance, WATER
    front = (inside - water) / (inside + water)
    back = (bench.behind - inside) / (bench.behind + inside)
    floor = bench.floor if bench.floor_gap_mm is not None else 0.0
    face, top = bench.probe_face, -front
    found: list[tuple[float, int, int, int]] = []
    first = 1
    if bench.coupling == "contact":
        first, top = 0, 0.6  # the probe itself is the front face
        found += [(back * (top * back) ** (k - 1), 0, k, 0) for k in range(1, 12)]
    else:
        through = 1.0 - front**2
        found.append((front, 1, 0, 0))
        found += [(through * back * (top * back) ** (k - 1), 1, k, 0) for k in range(1, 12)]
        found.append((front**2 * face, 2, 0, 0))
        found += [
            (2.0 * front * face * through * back * (top * back) ** (k - 1), 2, k, 0) for k in (1, 2)
        ]
        found.append((front**3 * face**2, 3, 0, 0))
    beyond = (1.0 - back**2) * floor * (1.0 - front**2 if first else 1.0)
    outer = -back * floor
    found += [(beyond * outer ** (k - 1), first, 1, k) for k in range(1, 5)]
    found.append((2.0 * beyond * top * back, first, 2, 1))
    return [one for one in found if abs(one[0]) > FAINTEST]


__all__ = ["AUDIBLE", "WATER", "Bench", "Hit", "Laboratory", "Matter", "laboratory"]
