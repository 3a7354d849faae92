"""Random draws of plates, pulses and immersion recordings, before anything goes wrong."""

from dataclasses import replace
from typing import Any

import numpy as np

from tests.scenes.laboratory.bench import WATER, Bench, Hit, Matter

Rng = np.random.Generator
MATTERS = {
    "acrylic": Matter(2.73, 3.22, 1.3, 1.1),
    "bone": Matter(2.85, 5.4, 4.5, 1.1),
    "epoxy, bone-like": Matter(2.85, 4.7, 3.0, 1.2),
    "PVC": Matter(2.38, 3.3, 2.6, 1.2),
    "polycarbonate": Matter(2.27, 2.7, 2.3, 1.3),
    "aluminium": Matter(6.32, 17.1, 0.02, 1.6),
    "steel": Matter(5.9, 46.0, 0.05, 2.0),
    "glass": Matter(5.6, 14.0, 0.02, 1.2),
}
SOFT = ("acrylic", "bone", "epoxy, bone-like", "PVC", "polycarbonate")
LEAST_LAG = 3.0  # of a back wall, over 1 / bandwidth
MOST_LOSS_DB = 34.0


def _hit(rng: Rng, centre_mhz: float, kind: str | None = None) -> Hit:
    kinds = ("spike", "square", "spike", "burst")
    chosen: Any = rng.choice(kinds) if kind is None else kind
    wide = rng.uniform(0.9, 1.6)  # quality: low is a short pulse
    resonances = ((1.0, 1.4 * wide), (rng.uniform(0.75, 1.3), wide))
    if rng.random() < 0.4:
        resonances = (*resonances, (rng.uniform(1.5, 1.9), 0.8))
    return Hit(
        kind=chosen,
        centre_mhz=centre_mhz,
        cycles=float(rng.uniform(1.0, 2.5)),
        resonances=resonances,
        turn=float(rng.uniform(0.0, 6.28)),
        ghost=float(rng.uniform(-0.06, 0.06)),
        ghost_cycles=float(rng.uniform(2.5, 7.0)),
    )


def usual(rng: Rng, **fixed: Any) -> Bench:
    """Return an immersion recording of a plate, nothing wrong with it."""
    centre = float(fixed.pop("centre_mhz", rng.choice([1.0, 1.5, 2.25, 2.25, 3.5, 5.0])))
    names = fixed.pop("of", tuple(MATTERS))
    matter = MATTERS[str(rng.choice(list(names)))]
    thickness = float(fixed.pop("thickness_mm", rng.uniform(2.0, 30.0)))
    standoff = float(rng.uniform(12.0, 60.0))
    lag = 2.0 * thickness / matter.speed
    bench = Bench(
        hit=_hit(rng, centre),
        matter=matter,
        thickness_mm=thickness,
        scans=int(rng.integers(25, 50)),
        layout=rng.choice(["raster", "raster", "line", "scatter"]),
        columns=int(rng.integers(1, 4)),
        sampling_mhz=float(rng.choice([8.0, 12.5, 20.0])) * max(centre, 2.0),
        length_us=standoff + lag * rng.uniform(1.25, 3.6) + 6.0,
        standoff_us=standoff,
        standoff_wedge_us=float(rng.normal(0.0, 0.3)),
        standoff_sd_us=float(rng.choice([0.002, 0.02, 0.2])),
        wedge_mm=float(rng.normal(0.0, 0.02 * thickness)),
        behind=float(rng.choice([WATER, WATER, 0.0004, 1.2])),
        radius_mm=float(rng.choice([3.2, 6.4, 9.5])),
        bang=float(rng.choice([0.0, 2.0, 6.0])),
        bang_us=0.8 / centre + rng.uniform(0.0, 0.5),
        noise=float(10.0 ** rng.uniform(-3.0, -1.9)),
        bits=int(rng.choice([10, 12, 14])),
        full_scale=float(rng.uniform(1.05, 2.5)),
    )
    return replace(bench, **fixed)


def is_readable(bench: Bench) -> bool:
    """Return whether the back wall's echo is clear of the front's and of the probe's multiples."""
    centre = bench.hit.centre_mhz
    lag = 2.0 * bench.thickness_mm / bench.matter.speed
    quality = max(q for _, q in bench.hit.resonances)
    pulse = quality / centre
    if bench.hit.kind in ("burst", "chirp"):
        pulse += bench.hit.cycles / centre
    way_cm = 0.2 * bench.thickness_mm
    loss = bench.matter.loss_db_per_cm * centre**bench.matter.power * way_cm
    if bench.coupling == "contact":
        loss *= 2.0
    # a multiple between probe and front may cover the back wall
    apart = min(abs(lag - k * bench.standoff_us) for k in (1, 2))
    apart = lag if bench.coupling == "contact" else apart
    return min(lag, 2.0 * apart) > LEAST_LAG * pulse and loss < MOST_LOSS_DB
