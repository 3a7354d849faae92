"""The echo model in the places of stored k-Wave fields: a plane wave in 1D, a strip in 2D.

The layers are those of the product; only the beam is another, for a strip has no disc's field.
The boundaries may be sharp, as in bone, or in mixed cells, as the grid of the field has them.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import hilbert
from scipy.special import hankel2

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Complexes
from rona_core.virtual.acoustics.layer_stack import BoneStack, LayerProfile
from rona_core.virtual.acoustics.medium import Medium
from tests.oracles.kwave_cells import LAYERS, THICKNESSES_MM, WATER, echo_in_cells

SHARED = Path(
    os.environ.get("RONA_SHARED", str(Path(__file__).resolve().parents[2].parent / "shared"))
)
LOSSLESS = Medium(
    gel=WATER,
    table=LAYERS[1],
    diploe=LAYERS[2],
    brain=LAYERS[4],
    ramp_mm=0.0,
    outer_roughness_mm=0.0,
    inner_roughness_mm=0.0,
    speckle=0.0,
)
STRIPS = ("1mhz_flat", "2.25mhz_flat", "2.25mhz_r80", "2.25mhz_tilt2")
RAYS, SOURCES = 121, 160
FACE_OVER_STRIP = 1.6
SOUNDLESS = 2e-3  # of the peak of a spectrum; what is below is not modelled
EMISSION_US = 10.5  # over by then; the echo comes later


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The same record by model and by the wave equation, (samples,)."""

    name: str
    model: Floats
    wave: Floats
    step_us: float
    front_us: tuple[float, float]  # where the echo of the outer boundary lies

    @property
    def l2_error(self) -> float:
        """Norm of the difference over that of the reference."""
        return float(np.linalg.norm(self.model - self.wave) / np.linalg.norm(self.wave))

    @property
    def correlation(self) -> float:
        """Correlation of the echoes."""
        late = slice(round(EMISSION_US / self.step_us), None)
        return float(np.corrcoef(self.model[late], self.wave[late])[0, 1])

    @property
    def front_db(self) -> float:
        """Level of the front echo of the model over that of the reference."""
        window = slice(*(round(t / self.step_us) for t in self.front_us))
        peaks = [envelope(rf)[window].max() for rf in (self.model, self.wave)]
        return float(20.0 * np.log10(peaks[0] / peaks[1]))

    @property
    def front_ns(self) -> float:
        """Delay of the front echo of the model after that of the reference."""
        window = slice(*(round(t / self.step_us) for t in self.front_us))
        a, b = self.model[window], self.wave[window]
        n = 16 * len(a)
        cross = np.fft.irfft(np.fft.rfft(a, 2 * len(a)) * np.conj(np.fft.rfft(b, 2 * len(a))), n)
        at = int(np.argmax(cross))
        lag = (at if at < n // 2 else at - n) * 2 * len(a) / n
        return 1e3 * float(lag) * self.step_us


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """A stored field in 2D: a strip over bone; depths are counted from the strip."""

    name: str
    half_mm: float
    reach_mm: float  # of the bone below the middle of the strip
    radius_mm: float  # of the bone; 0: flat
    lean_rad: float
    centre_mhz: float
    cell_mm: float
    cells: int  # of the strip
    step_us: float
    sent: Floats  # (samples,)
    heard: Floats  # (samples,) mean over the strip

    def outer_mm(self, x_mm: Floats) -> Floats:
        """Return the depth (n,) of the bone at places across."""
        sag = x_mm**2 / (2.0 * self.radius_mm) if self.radius_mm else 0.0
        return self.reach_mm + x_mm * np.tan(self.lean_rad) + sag

    def edges_mm(self, x_mm: Floats) -> Floats:
        """Return the depths (n, 4) of all boundaries; the layers are stacked along depth."""
        below = np.concatenate(([0.0], np.cumsum(THICKNESSES_MM)))
        return self.outer_mm(x_mm)[:, None] + below

    @property
    def front_us(self) -> tuple[float, float]:
        """Between when the front echo peaks."""
        peak_us = float(np.argmax(envelope(self.sent))) * self.step_us
        arrival = peak_us + 2.0 * self.reach_mm / WATER.speed_mm_per_us
        return arrival - 1.5 / self.centre_mhz, arrival + 1.5 / self.centre_mhz


def envelope(rf: Floats) -> Floats:
    """Return the envelope (samples,) of a record."""
    return np.abs(np.asarray(hilbert(rf), dtype=np.complex128))


def frequencies_mhz(samples: int, step_us: float) -> Floats:
    """Return the frequencies (samples // 2 + 1,) of a real transform."""
    return np.asarray(np.arange(samples // 2 + 1) / (samples * step_us), dtype=np.float64)


def stored(name: str) -> dict[str, Floats] | None:
    """Return a stored field by its name, None where it is not here."""
    path = SHARED / "data" / "kwave" / f"kwave_{name}.npz"
    if not path.exists():
        return None
    with np.load(path) as data:
        return {key: np.asarray(data[key]) for key in data.files}


def stored_strip(name: str) -> Strip | None:
    """Return a stored strip by its name, None where it is not here."""
    data = stored(f"2d_{name}")
    if data is None:
        return None
    a, reach, radius, cell = (1e3 * float(data[key]) for key in ("a", "L", "Rc", "dx"))
    return Strip(
        name,
        half_mm=a,
        reach_mm=reach,
        radius_mm=radius,
        lean_rad=float(data["tilt"]),
        centre_mhz=1e-6 * float(data["fc"]),
        cell_mm=cell,
        cells=len(data["x"]),
        step_us=1e6 * float(data["dt"]),
        sent=data["sig"],
        heard=data["p"],
    )


def bone_echo(
    weights: Complexes, frequencies_mhz: Floats, gap_mm: Floats, lean_rad: float, exact: bool
) -> Complexes:
    """Return the echo (f,) of the reference's bone under rays of these weights (n, f)."""
    stack = BoneStack(WATER, LOSSLESS, frequencies_mhz, film_mm=0.0, seed=0, exact=exact)
    ones = np.ones(len(gap_mm))
    table, diploe, inner_table = THICKNESSES_MM
    profile = LayerProfile(
        outer_mm=gap_mm,
        table_mm=table * ones,
        diploe_mm=diploe * ones,
        inner_table_mm=inner_table * ones,
        hit=ones > 0,
        entries_skull=np.zeros((len(gap_mm), 3)),
        outer_angle_rad=lean_rad * ones,
    )
    cast = weights if exact else weights.astype(np.complex64)
    return np.asarray(stack.echo(cast, profile), dtype=np.complex128)


def plane_wave(exact: bool = False) -> Comparison | None:
    """Return four layers under a plane wave; None where the field is not here."""
    data = stored("1d")
    if data is None:
        return None
    dt, dx = float(data["dt"]) * 1e6, float(data["dx"]) * 1e3
    source_mm, sensor_mm = (int(data["i0"]) + 0.5) * dx, (int(data["i1"]) + 0.5) * dx
    n = 1 << 16
    t, f = np.arange(n) * dt, frequencies_mhz(n, dt)
    sent = np.exp(-((t - 2) ** 2) / (2 * 0.22**2)) * np.cos(2 * np.pi * 2 * (t - 2))
    band = (f > 0.01) & (f < 6.0)
    passed, back = sensor_mm - source_mm, 40.0 - source_mm - sensor_mm
    there = np.exp(-2j * np.pi * f[band] * back / WATER.speed_mm_per_us)
    echo = np.zeros(n // 2 + 1, dtype=np.complex128)
    echo[band] = np.exp(-2j * np.pi * f[band] * passed / WATER.speed_mm_per_us)
    echo[band] += there * bone_echo(
        np.ones((1, band.sum()), dtype=np.complex128), f[band], np.zeros(1), 0.0, exact
    )
    wave = data["p"]
    model = np.fft.irfft(np.fft.rfft(sent) * echo, n)[: len(wave)]
    arrival = 2.0 + back / WATER.speed_mm_per_us
    return Comparison("plane wave", model, wave, dt, (arrival - 1.0, arrival + 1.0))


def strip(name: str, exact: bool = False, *, cells: bool = False) -> Comparison | None:
    """Return a strip aperture over bone in 2D; None where the field is not here.

    Args:
        name: One of ``STRIPS``.
        exact: Count the layers with 53 bits.
        cells: Boundaries in mixed cells, as the grid of the field has them, and not sharp.
    """
    case = stored_strip(name)
    if case is None:
        return None
    model = strip_record(case, exact=exact, cell_mm=case.cell_mm if cells else None)
    return Comparison(name, model, case.heard, case.step_us, case.front_us)


def strip_record(case: Strip, *, exact: bool, cell_mm: float | None = None) -> Floats:
    """Return the record (samples,) of the model, in mixed cells of ``cell_mm`` or sharp."""
    n, a = 1 << 13, case.half_mm
    f, spectrum = frequencies_mhz(n, case.step_us), np.fft.rfft(case.sent, n)
    heard = np.flatnonzero(np.abs(spectrum) > SOUNDLESS * np.abs(spectrum).max())
    band = np.arange(heard[0], heard[-1] + 1)
    x = np.linspace(-FACE_OVER_STRIP * a, FACE_OVER_STRIP * a, RAYS)
    field = strip_field(a, case.reach_mm, x, WATER.wavenumber_per_mm(f[band]).real)
    weights = field**2 * (x[1] - x[0]) / (2.0 * a)
    total = np.zeros(len(f), dtype=np.complex128)
    if cell_mm is None:
        gap = case.outer_mm(x) - case.reach_mm
        total[band] = bone_echo(weights, f[band], gap, case.lean_rad, exact)
    else:
        total[band] = echo_in_cells(weights, f[band], case.edges_mm(x), cell_mm, case.reach_mm)
    return np.fft.irfft(spectrum * total, n)[: len(case.heard)]


def strip_field(half_mm: float, distance_mm: float, offsets_mm: Floats, k: Floats) -> Complexes:
    """Return the field (m, f) of a strip of unit pressure: the Rayleigh integral in 2D."""
    source = ((np.arange(SOURCES) + 0.5) / SOURCES * 2.0 - 1.0) * half_mm
    way = np.hypot(offsets_mm[:, None] - source, distance_mm)
    share = -0.5j * distance_mm / way * (2.0 * half_mm / SOURCES)
    columns = [(kj * share * hankel2(1, kj * way)).sum(axis=1) for kj in k]
    return np.stack(columns, axis=1)


def mirror_level_db(
    lean_deg: float, frequency_mhz: float, half_mm: float, reach_mm: float
) -> float:
    """Return the rays' echo of a leaning mirror over that of the strip's image, without a grid."""
    k = 2.0 * np.pi * frequency_mhz / WATER.speed_mm_per_us
    lean = np.deg2rad(lean_deg)
    x = np.linspace(-FACE_OVER_STRIP * half_mm, FACE_OVER_STRIP * half_mm, RAYS)
    field = strip_field(half_mm, reach_mm, x, np.array([k]))[:, 0]
    rays = np.sum(field**2 * np.exp(-2j * k * x * np.tan(lean))) * (x[1] - x[0]) / (2.0 * half_mm)
    source = ((np.arange(SOURCES) + 0.5) / SOURCES * 2.0 - 1.0) * half_mm
    behind = reach_mm * np.cos(lean) + source * np.sin(lean)  # from the strip to the mirror
    aside, below = source - 2.0 * behind * np.sin(lean), 2.0 * behind * np.cos(lean)
    way = np.hypot(source[:, None] - aside, below)
    image = np.sum(0.5 * k * hankel2(0, k * way)) * 2.0 * half_mm / SOURCES**2
    return float(20.0 * np.log10(np.abs(rays) / np.abs(image)))
