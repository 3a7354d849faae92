"""Families of recordings, each drawn at random: what laboratories put into a tank or on a plate.

A draw is thrown away only where nobody could read the trace: the back wall's echo lies within the
pulse of the front, or drowns in the noise (but for the family in which it has to).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.scenes.laboratory.draws import SOFT, is_readable, usual
from tests.scenes.laboratory.laboratory import AUDIBLE, WATER, Bench, Laboratory, laboratory

Rng = np.random.Generator
TRIES = 200


def immersed(rng: Rng) -> Bench:
    return usual(rng)


def thick(rng: Rng) -> Bench:
    made = usual(rng, thickness_mm=30.0)
    lag = 60.0 / made.matter.speed
    return replace(made, length_us=made.standoff_us + rng.choice([1.3, 2.4, 3.5]) * lag)


def delay_line(rng: Rng) -> Bench:
    made = usual(rng, thickness_mm=rng.uniform(2.0, 14.0), columns=2)
    lag = 2.0 * made.thickness_mm / made.matter.speed
    line = max(rng.uniform(9.0, 22.0), 1.15 * lag)
    return replace(
        made,
        coupling="delay line",
        standoff_us=line,
        standoff_sd_us=0.004,
        standoff_wedge_us=rng.normal(0.0, 0.03),
        length_us=rng.uniform(1.3, 2.6) * line + lag,
        bang=rng.choice([3.0, 8.0]),
        probe_face=rng.choice([-0.3, 0.3, 0.5]),
        start_known=rng.random() < 0.7,
    )


def contact(rng: Rng) -> Bench:
    made = usual(rng, thickness_mm=rng.uniform(5.0, 30.0))
    lag = 2.0 * made.thickness_mm / made.matter.speed
    return replace(
        made,
        coupling="contact",
        length_us=lag * rng.uniform(2.6, 5.0) + 4.0,
        bang=rng.choice([2.0, 10.0]),
        start_us=0.0,
        behind=rng.choice([WATER, 0.0004]),
    )


def clipped(rng: Rng) -> Bench:
    made = usual(rng)
    return replace(
        made,
        full_scale=1.0 / rng.uniform(2.0, 12.0),
        bits=rng.choice([8, 12, 14]),
        noise=10.0 ** rng.uniform(-3.3, -2.3),
        bang=rng.choice([0.0, 10.0]),
    )


def layer_behind(rng: Rng) -> Bench:
    made = usual(rng, thickness_mm=rng.uniform(4.0, 30.0), of=SOFT, behind=WATER)
    gap = rng.uniform(2.5, 25.0)
    further = 2.0 * made.thickness_mm / made.matter.speed + 2.0 * gap / WATER
    return replace(
        made,
        floor_gap_mm=gap,
        floor=rng.choice([0.4, 0.9, -0.95]),
        length_us=made.standoff_us + rng.uniform(1.2, 2.0) * further,
    )


def drifting(rng: Rng) -> Bench:
    return usual(
        rng,
        standoff_wedge_us=rng.uniform(-8.0, 8.0),
        standoff_sd_us=rng.choice([0.05, 0.5, 2.0]),
        standoff_us=rng.uniform(20.0, 50.0),
        length_us=90.0,
    )


def poor_recorder(rng: Rng) -> Bench:
    made = usual(rng)
    return replace(
        made,
        bits=8,
        noise=10.0 ** rng.uniform(-2.5, -1.8),
        offset=rng.normal(0.0, 0.3),
        slow=rng.uniform(0.0, 0.4),
        spikes=rng.choice([0.0, 0.5, 2.0]),
        hum=rng.choice([0.0, 0.01, 0.03]),
        full_scale=rng.uniform(0.9, 2.5),
    )


def faulty_scans(rng: Rng) -> Bench:
    made = usual(rng)
    return replace(
        made,
        dead=rng.choice([0.0, 0.1]),
        saturated=rng.choice([0.0, 0.1]),
        doubled=rng.choice([0.0, 0.2]),
        lifted=rng.choice([0.0, 0.15]),
    )


def few_scans(rng: Rng) -> Bench:
    made = usual(rng)
    return replace(
        made,
        scans=rng.choice([1, 1, 2, 3, 5]),
        layout=rng.choice(["none", "line"]),
        full_scale=rng.choice([0.5, 1.5]),
    )


def few_after_bang(rng: Rng) -> Bench:
    made = usual(rng, thickness_mm=rng.uniform(3.0, 12.0))
    standoff = rng.uniform(6.0, 10.0) * max(1.0, 1.5 / made.hit.centre_mhz)
    return replace(
        made,
        scans=rng.choice([1, 2, 4]),
        standoff_us=standoff,
        standoff_sd_us=0.02,
        length_us=standoff + 40.0,
        bang=rng.choice([5.0, 20.0]),
        start_known=rng.random() < 0.5,
    )


def odd_pulse(rng: Rng) -> Bench:
    made = usual(rng)
    kind = str(rng.choice(["single", "ringing", "burst"]))
    if kind == "single":
        hit = replace(made.hit, kind="square", resonances=((1.0, 0.6),))
    elif kind == "ringing":
        hit = replace(made.hit, kind="spike", resonances=((1.0, 4.0), (1.03, 3.0)))
    else:
        hit = replace(made.hit, kind="burst", cycles=rng.uniform(3.0, 6.0))
    return replace(made, hit=hit)


def chirped(rng: Rng) -> Bench:
    made = usual(rng, thickness_mm=rng.uniform(10.0, 30.0))
    hit = replace(
        made.hit, kind="chirp", cycles=rng.uniform(6.0, 20.0), resonances=((1.0, 0.9), (1.1, 0.9))
    )
    lag = 2.0 * made.thickness_mm / made.matter.speed
    last = hit.cycles / hit.centre_mhz
    return replace(made, hit=hit, length_us=made.standoff_us + 2.4 * lag + last)


def extremes(rng: Rng) -> Bench:
    if rng.random() < 0.5:
        made = usual(rng, centre_mhz=0.5, thickness_mm=rng.uniform(15.0, 40.0))
        return replace(made, sampling_mhz=rng.choice([10.0, 25.0]), standoff_us=50.0, length_us=140)
    made = usual(rng, centre_mhz=rng.choice([7.5, 10.0]), thickness_mm=rng.uniform(1.0, 8.0))
    return replace(made, sampling_mhz=rng.choice([100.0, 125.0]))


def late_record(rng: Rng) -> Bench:
    made = usual(rng)
    known = rng.random() < 0.5
    start = rng.choice([-3.0, made.standoff_us - rng.uniform(3.0, 8.0)])
    return replace(made, start_us=start, start_known=known, length_us=made.length_us - start)


def bone(rng: Rng) -> Bench:
    made = usual(rng, of=("bone",), centre_mhz=rng.choice([1.0, 2.25]))
    thickness = rng.uniform(3.5, 9.0)
    return replace(
        made,
        thickness_mm=thickness,
        wedge_mm=0.0,
        waves_mm=0.08 * thickness,
        back_spread=0.35,
        behind=rng.choice([WATER, 1.6]),
        floor_gap_mm=rng.choice([0.0, rng.uniform(5.0, 15.0)]) or None,
        noise=10.0 ** rng.uniform(-3.3, -2.5),
        length_us=made.standoff_us + 30.0,
    )


def inaudible(rng: Rng) -> Bench:
    """Return a plate that swallows what enters it: only water's multiples follow the front."""
    made = usual(rng, thickness_mm=rng.uniform(5.0, 20.0), of=SOFT)
    way = 0.2 * made.thickness_mm * made.hit.centre_mhz
    return replace(
        made,
        matter=replace(made.matter, loss_db_per_cm=90.0 / way, power=1.0),
        length_us=made.standoff_us + 60.0,
    )


FAMILIES: dict[str, Callable[[Rng], Bench]] = {
    "immersed": immersed,
    "thick": thick,
    "delay line": delay_line,
    "contact": contact,
    "clipped": clipped,
    "layer behind": layer_behind,
    "drifting": drifting,
    "poor recorder": poor_recorder,
    "faulty scans": faulty_scans,
    "few scans": few_scans,
    "few after bang": few_after_bang,
    "odd pulse": odd_pulse,
    "chirped": chirped,
    "extremes": extremes,
    "late record": late_record,
    "bone": bone,
    "inaudible": inaudible,
}


def draw(family: str, seed: int) -> tuple[Bench, Laboratory]:
    """Return a recording of a family, its plate readable."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family)])
    for _ in range(TRIES):
        bench = FAMILIES[family](rng)
        if family != "inaudible" and not is_readable(bench):
            continue
        made = laboratory(bench, rng)
        if made.audible != (family == "inaudible"):
            return bench, made
    raise RuntimeError(f"no readable recording of {family} in {TRIES} draws, seed {seed}")


__all__ = ["AUDIBLE", "FAMILIES", "draw"]
