"""What a laboratory's recording is made of: plate, pulse, arrangement, recorder and its faults.

Times are us, frequencies MHz, lengths mm, impedances MRayl.
"""

from dataclasses import dataclass
from typing import Literal

Coupling = Literal["immersion", "delay line", "contact"]
WATER, WATER_SPEED = 1.483, 1.483


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
