"""Pulse-echo recordings of plates as laboratories make them, with the truth about each scan.

Every arrival is a copy of one pulse, delayed, damped with the dispersion that belongs to the
damping, and spread by the field of a round piston. Pulses are made as hardware makes them: an
excitation drives resonators twice. Times are us, frequencies MHz, lengths mm, impedances MRayl.
Nothing of the program's own models is used.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0, j1

from rona_core.arrays import Bools, Floats
from rona_core.devices.rf_files import RecordedRf

Complexes = NDArray[np.complex128]
Coupling = Literal["immersion", "delay line", "contact"]
WATER, WATER_SPEED = 1.483, 1.483
FAINTEST = 1e-4  # arrivals below it over a perfect mirror are left out
AUDIBLE = 4.0  # the back wall's peak over the rms of noise and quantising


@dataclass(frozen=True, slots=True)
class Matter:
    """What a plate is made of."""

    speed: float
    impedance: float
    loss_db_per_cm: float  # at 1 MHz
    power: float


@dataclass(frozen=True, slots=True)
class Hit:
    """How the pulse is made: an excitation, resonators that it drives twice, a late ghost."""

    kind: Literal["spike", "square", "burst", "chirp"]
    centre_mhz: float
    cycles: float  # of a burst; of a chirp its length
    resonances: tuple[tuple[float, float], ...]  # frequency over the centre, quality
    turn: float  # rad by which the electronics turn every frequency
    ghost: float  # amplitude of a second arrival from within the probe
    ghost_cycles: float


@dataclass(frozen=True, slots=True)
class Bench:
    """One recording: the arrangement, the plate, the recorder and its faults."""

    hit: Hit
    matter: Matter
    thickness_mm: float
    coupling: Coupling = "immersion"
    scans: int = 40
    layout: Literal["raster", "line", "scatter", "none"] = "raster"
    columns: int = 2  # of the positions that are written
    sampling_mhz: float = 50.0
    length_us: float = 60.0
    standoff_us: float = 25.0  # two-way, to the front of the plate
    standoff_wedge_us: float = 0.0  # across the scans
    standoff_sd_us: float = 0.02
    wedge_mm: float = 0.0
    waves_mm: float = 0.0  # smooth, rms
    behind: float = WATER  # impedance
    floor_gap_mm: float | None = None
    floor: float = 0.8
    probe_face: float = 0.35  # reflection of the probe for what comes back
    radius_mm: float = 6.0  # of the piston
    back_spread: float = 0.1  # of the amplitude, natural logarithm
    bang: float = 0.0  # over the front
    bang_us: float = 0.5  # in which its ring-down falls by e
    start_us: float = 0.0
    start_known: bool = True
    noise: float = 0.003  # over the front's peak
    full_scale: float = 1.2  # likewise
    bits: int | None = 12
    offset: float = 0.0
    slow: float = 0.0
    spikes: float = 0.0  # in a line, on average
    hum: float = 0.0
    dead: float = 0.0  # shares of scans
    saturated: float = 0.0
    doubled: float = 0.0
    lifted: float = 0.0  # no contact: noise alone


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
    pulse = _pulse(bench.hit, f)
    level = np.exp(0.05 * rng.standard_normal(n))
    back = np.exp(bench.back_spread * rng.standard_normal(n))
    lift = rng.random(n) < bench.lifted
    scale = float(np.abs(np.fft.irfft(pulse * _piston(bench, f, 0.0), size)).max())
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
        copy = _copy(bench, f[used], water - bench.start_us, way)
        spectrum[:, used] += gain[:, None] * copy
        if (plates, gaps, waters <= 1) == (trips, 0, True):
            wall[0, used] += (height * copy[:1])[0]
        if number == 0:
            first = abs(height)
    rf = np.fft.irfft(spectrum * pulse, size, axis=1)[:, :m] / (scale * first)
    heard = float(np.abs(np.fft.irfft(wall * pulse, size)[0, :m]).max()) / (scale * first)
    rf[lift] = 0.0
    rf += _bang(bench, m, rng)
    rf = _faulty(bench, rf, rng)
    floor = float(np.hypot(bench.noise, _step(bench) / np.sqrt(12.0)))
    rf, order, spoilt = _written(bench, rf, rng)
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


# ------------------------------------------------------------------ arrangement


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


def _copy(bench: Bench, f: Floats, water_us: Floats, way_mm: Floats) -> Complexes:
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
    return phase * _piston(bench, f, max(depth + bench.start_us * WATER_SPEED, 0.0))


def _piston(bench: Bench, f: Floats, path_mm: float) -> Complexes:
    """Return what a round piston hears of a mirror at half of this path."""
    ratio = path_mm * WATER_SPEED / np.maximum(f, 1e-3) / bench.radius_mm**2
    x = 2.0 * np.pi / np.maximum(ratio, 1e-6)
    return 1.0 - np.exp(-1j * x) * (j0(x) + 1j * j1(x))


# ------------------------------------------------------------------ pulse


def _pulse(hit: Hit, f: Floats) -> Complexes:
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


def _bang(bench: Bench, m: int, rng: np.random.Generator) -> Floats:
    """Return what is left of the emission, nearly the same in every scan."""
    t = bench.start_us + np.arange(m) / bench.sampling_mhz
    after = np.maximum(t, 0.0)
    wave = np.zeros(m)
    for over in (0.25, 0.9, 1.15):
        wave += np.cos(2.0 * np.pi * over * bench.hit.centre_mhz * after + rng.uniform(0, 6.28))
    wave = bench.bang * wave * np.exp(-after / bench.bang_us) * (t >= 0)
    return wave * np.exp(0.01 * rng.standard_normal((bench.scans, 1)))


# ------------------------------------------------------------------ recorder


def _faulty(bench: Bench, rf: Floats, rng: np.random.Generator) -> Floats:
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


def _step(bench: Bench) -> float:
    return 0.0 if bench.bits is None else bench.full_scale / 2.0 ** (bench.bits - 1)


def _written(
    bench: Bench, rf: Floats, rng: np.random.Generator
) -> tuple[Floats, NDArray[np.int64], Bools]:
    n = len(rf)
    order = np.arange(n)
    twice = np.flatnonzero(rng.random(n) < bench.doubled)
    order[twice] = np.maximum(twice - 1, 0)  # the line before was written again
    rf = np.clip(rf, -bench.full_scale, bench.full_scale)
    if bench.bits is not None:
        rf = np.rint(rf / _step(bench))
        rf = np.clip(rf, -(2.0 ** (bench.bits - 1)), 2.0 ** (bench.bits - 1) - 1)
    top = float(rf.max())
    dead = rng.random(n) < bench.dead
    full = rng.random(n) < bench.saturated
    rf = rf[order]
    rf[dead], rf[full] = 0.0, top
    return rf, order, dead | full
