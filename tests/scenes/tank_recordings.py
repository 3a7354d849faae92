"""Recordings of plates in a tank, made on the spot: for judging detection without a known probe.

It shares nothing with the product's own model of echoes: pulses are damped sines, Gaussians or
rings, layers are lists of arrival times, and the recorder clips, counts in bits, drifts and hums.
Times are us, frequencies MHz, lengths mm.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats

Shape = Literal["ring", "gauss", "damped"]
WATER = 1.483


@dataclass(frozen=True, slots=True)
class Case:
    """What is recorded, and how; levels are amplitudes over that of a perfect mirror."""

    scans: int = 60
    sampling_mhz: float = 50.0
    length_us: float = 60.0
    centre_mhz: float = 2.25
    bandwidth: float = 0.46
    shape: Shape = "ring"
    inverted: bool = False
    standoff_us: float = 20.0  # two-way, to the front of the plate
    standoff_sd_us: float = 0.3
    thickness_mm: float = 6.0
    wedge_mm: float = 0.0  # thicker by this from one end of the raster to the other
    bumps_mm: float = 0.0  # smooth rms of thickness
    speed: float = 2.85
    front: float = 0.5
    back: float | None = None  # of the back face from inside; minus the front's where None
    loss_db_per_cm_mhz: float = 3.0
    power: float = 1.0
    floor_gap_mm: float | None = None  # water between the plate and a floor
    floor: float = 0.9
    multiples: int = 2
    bang: float = 0.0  # amplitude of the transmitter's ring-down
    snr_db: float = 40.0  # of the front echo, peak over rms of white noise
    full_scale: float = 1.3  # over the front's peak; below 1 it is clipped
    bits: int | None = 12
    offset: float = 0.05
    drift: float = 0.05
    hum: float = 0.0  # amplitude of a narrow line at 5.1 MHz
    rough: float = 0.1  # relative spread of amplitudes
    dropout: float = 0.0  # share of scans without contact
    start_known: bool = True
    start_us: float = 0.0
    positions: bool = True
    internal: float = 0.0  # reflection of a layer within the plate, at 40 % of its depth
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recording and the truth about it."""

    file: RecordedRf
    thickness_mm: Floats
    contact: Bools


def record(case: Case) -> Recording:
    """Return what the recorder writes for a case."""
    rng = np.random.default_rng(case.seed)
    n, m = case.scans, round(case.length_us * case.sampling_mhz)
    positions, thickness = _plate(case, rng)
    standoff = case.standoff_us + case.standoff_sd_us * rng.standard_normal(n)
    contact = rng.random(n) >= case.dropout
    size = 2 * m
    f: Floats = np.fft.rfftfreq(size, 1.0 / case.sampling_mhz).astype(np.float64)
    pulse = _pulse(case, f, size)
    spectrum = np.zeros((n, len(f)), dtype=np.complex128)
    for level, water_us, bone_mm in _arrivals(case, standoff, thickness):
        gain = np.where(contact, level * np.exp(case.rough * rng.standard_normal(n)), 0.0)
        spectrum += gain[:, None] * _path(case, f, water_us - case.start_us, bone_mm)
    rf = np.fft.irfft(spectrum * pulse, size, axis=1)[:, :m]
    peak = float(np.abs(np.fft.irfft(pulse, size)).max()) * case.front
    t = case.start_us + np.arange(m) / case.sampling_mhz
    if case.bang > 0:
        decay = np.exp(-np.maximum(t, 0.0) / 0.8) * np.sin(2 * np.pi * 1.1 * case.centre_mhz * t)
        rf = rf + np.where(t >= 0, case.bang * peak * decay, 0.0)
    rf = rf / peak * (-1.0 if case.inverted else 1.0)
    rf += rng.normal(0.0, 10.0 ** (-case.snr_db / 20.0), rf.shape)
    rf += case.hum * np.sin(2 * np.pi * (5.1 * t + rng.random((n, 1))))
    slow = rng.normal(0.0, 1.0, (n, 1)) * np.sin(2 * np.pi * (t / 90.0 + rng.random((n, 1))))
    rf += case.offset + case.drift * slow
    return Recording(_written(case, rf, positions), thickness, contact)


def varied(case: Case, **changes: Any) -> Case:
    """Return a case with some things otherwise."""
    return replace(case, **changes)


def _plate(case: Case, rng: np.random.Generator) -> tuple[Floats, Floats]:
    side = int(np.ceil(np.sqrt(case.scans)))
    places = np.arange(case.scans)
    row = places // side
    column = np.where(row % 2 == 0, places % side, side - 1 - places % side)  # to and fro
    xy = 2.0 * np.column_stack((column, row)).astype(np.float64)
    thickness = case.thickness_mm + case.wedge_mm * (xy[:, 0] / max(2.0 * (side - 1), 1.0) - 0.5)
    if case.bumps_mm > 0:
        waves = rng.normal(0.0, 2 * np.pi / 25.0, (2, 12))
        bumps = np.cos(xy @ waves + rng.uniform(0, 2 * np.pi, 12)).sum(axis=1) / np.sqrt(6.0)
        thickness = thickness + case.bumps_mm * bumps
    return xy, thickness


def _pulse(case: Case, f: Floats, size: int) -> NDArray[np.complex128]:
    fc, width = case.centre_mhz, case.bandwidth * case.centre_mhz
    t = np.arange(size) / case.sampling_mhz
    if case.shape == "gauss":
        scale = width / 2.0 / np.sqrt(np.log(2.0))
        return np.exp(-(((f - fc) / scale) ** 2)) * np.exp(-2j * np.pi * f * 2.0 / width)
    if case.shape == "damped":  # a hard hit that dies away
        envelope = np.where(t > 0, (1.0 - np.exp(-3.0 * t * width)) * np.exp(-2.2 * width * t), 0.0)
    else:  # swells, dies, and comes a little back
        envelope = (width * t) ** 2 * np.exp(-3.5 * width * t)
        late = np.maximum(t - 2.6 / fc, 0.0)
        envelope = envelope - 0.12 * (width * late) ** 2 * np.exp(-3.0 * width * late)
    pulse = envelope * np.sin(2 * np.pi * fc * t + 0.4)
    return np.fft.rfft(pulse)


def _arrivals(
    case: Case, standoff: Floats, thickness: Floats
) -> list[tuple[float, Floats, Floats]]:
    """Return level, two-way time in water, and way in the plate of every echo."""
    r = case.front
    back = -r if case.back is None else case.back
    through = 1.0 - r * r
    none = np.zeros_like(thickness)
    found = [(r, standoff, none)]
    if case.internal:
        found.append((through * case.internal, standoff, 0.8 * thickness))
    for k in range(case.multiples + 1):
        found.append((through * back * (-r * back) ** k, standoff, 2.0 * (k + 1) * thickness))
    found.append((-0.3 * r * r, 2.0 * standoff, none))  # from the face of the probe again
    if case.floor_gap_mm is not None:
        gap = 2.0 * case.floor_gap_mm / WATER
        passed = through * (1.0 - back * back)
        for k in range(3):
            level = passed * case.floor * (-case.floor * back) ** k
            found.append((level, standoff + (k + 1) * gap, 2.0 * thickness))
        found.append((2.0 * passed * case.floor * r * r, standoff + gap, 4.0 * thickness))
    return found


def _path(case: Case, f: Floats, water_us: Floats, way_mm: Floats) -> NDArray[np.complex128]:
    loss = case.loss_db_per_cm_mhz / 86.859  # Np/mm at 1 MHz
    safe = np.maximum(f, 1e-3)
    damping = np.where(f > 0, loss * safe**case.power, 0.0)
    if case.power == 1.0:
        slowness = -loss / np.pi**2 * np.log(safe / case.centre_mhz)
    else:
        y = case.power - 1.0
        turn = np.tan(np.pi * case.power / 2.0) / (2.0 * np.pi)
        slowness = loss * turn * (safe**y - case.centre_mhz**y)
    delay = water_us[:, None] + way_mm[:, None] * (1.0 / case.speed + slowness)
    return np.exp(-2j * np.pi * f * delay - damping * way_mm[:, None])


def _written(case: Case, rf: Floats, positions: Floats) -> RecordedRf:
    top = case.full_scale
    rf = np.clip(rf, -top, top)
    if case.bits is not None:
        steps = 2.0 ** (case.bits - 1) - 1
        rf = np.rint(rf / top * steps)
    return RecordedRf(
        name="made.npz",
        rf=rf,
        sampling_mhz=case.sampling_mhz,
        start_us=case.start_us if case.start_known else 0.0,
        start_known=case.start_known,
        positions_mm=positions if case.positions else None,
    )


PLATE = Case()
BONE = Case(
    thickness_mm=6.0, bumps_mm=0.8, front=0.55, loss_db_per_cm_mhz=6.0, snr_db=50.0, bits=14
)
PMMA = Case(thickness_mm=10.0, speed=2.72, front=0.37, loss_db_per_cm_mhz=1.0)
ALUMINIUM = Case(thickness_mm=8.0, speed=6.35, front=0.84, loss_db_per_cm_mhz=0.05, multiples=5)

CASES: dict[str, Case] = {
    "plate": PLATE,
    "plate, 30 mm": varied(
        PLATE, thickness_mm=30.0, standoff_us=28.0, loss_db_per_cm_mhz=1.5, length_us=80.0
    ),
    "plate over a floor": varied(PLATE, floor_gap_mm=12.0),
    "PMMA over a floor": varied(PMMA, floor_gap_mm=15.0),
    "PMMA 30 mm, clipped, floor": varied(
        PMMA, thickness_mm=30.0, floor_gap_mm=10.0, full_scale=0.4, length_us=80.0
    ),
    "aluminium, many multiples": ALUMINIUM,
    "aluminium 5 MHz, floor": varied(
        ALUMINIUM, centre_mhz=5.0, sampling_mhz=100.0, bandwidth=0.6, floor_gap_mm=8.0
    ),
    "clipped by 4": varied(PLATE, full_scale=0.25),
    "clipped by 4, 8 bits, inverted": varied(PLATE, full_scale=0.25, bits=8, inverted=True),
    "clipped by 10": varied(PLATE, full_scale=0.1, bits=12),
    "clipped by 6": varied(PLATE, full_scale=1 / 6, bits=12),
    "clipped by 10, bone": varied(BONE, full_scale=0.1),
    "clipped by 4, 30 mm, floor": varied(
        PMMA, thickness_mm=30.0, full_scale=0.25, floor_gap_mm=20.0, length_us=90.0, bits=8
    ),
    "inverted, air behind": varied(PLATE, inverted=True, back=-0.98),
    "steel behind": varied(PLATE, back=0.7),
    "ring-down": varied(PLATE, bang=4.0, standoff_us=9.0, standoff_sd_us=0.5),
    "ring-down, same stand-off": varied(PLATE, bang=4.0, standoff_us=12.0, standoff_sd_us=0.001),
    "stand-off varies by 5 us": varied(PLATE, standoff_sd_us=4.0, floor_gap_mm=14.0),
    "drift, hum, 8 bits": varied(PLATE, drift=0.4, hum=0.05, bits=8, offset=-0.3),
    "10 MHz sampling": varied(PLATE, sampling_mhz=10.0),
    "1 MHz": varied(PLATE, centre_mhz=1.0, thickness_mm=10.0, sampling_mhz=20.0),
    "5 MHz, thin": varied(PLATE, centre_mhz=5.0, thickness_mm=2.5, sampling_mhz=100.0),
    "Gaussian pulse": varied(PLATE, shape="gauss", bandwidth=0.7),
    "damped pulse": varied(PLATE, shape="damped", bandwidth=0.35),
    "wedge": varied(PLATE, wedge_mm=2.0),
    "no positions, no t0": varied(
        PLATE, positions=False, start_known=False, start_us=14.0, wedge_mm=1.0
    ),
    "bone": BONE,
    "bone 3 mm": varied(BONE, thickness_mm=3.0, bumps_mm=0.4),
    "bone, layer inside": varied(BONE, internal=-0.02),
    "bone over a floor": varied(BONE, floor_gap_mm=10.0),
    "bone, lossy, y 1.3": varied(BONE, power=1.3, loss_db_per_cm_mhz=5.0),
    "weak: 25 dB": varied(PLATE, snr_db=25.0),
    "weak: 15 dB": varied(PLATE, snr_db=15.0),
    "weak: 20 dB, 200 scans, wedge": varied(PLATE, snr_db=20.0, scans=200, wedge_mm=2.0),
    "dropouts": varied(PLATE, dropout=0.1, floor_gap_mm=12.0),
    "one scan": varied(PLATE, scans=1),
    "one scan over a floor": varied(PLATE, scans=1, floor_gap_mm=12.0),
    "three scans, clipped": varied(PLATE, scans=3, full_scale=0.4),
    "water multiple before the back": varied(
        PLATE, thickness_mm=25.0, standoff_us=13.0, loss_db_per_cm_mhz=1.0, length_us=70.0
    ),
}
