"""Does the force stop the burr for nothing? Accepted beds of virtual patients, rehearsed.

Whole procedures of the realistic world with the simulated skull; tracker, robot and pointer by the
balanced design. Of each patient several beds that step 10 accepts are milled as planned without a
guard, with the force alone, and with all guards. A bed counts that keeps its limit when it is
milled as planned: all along its way at least the limit of true bone is below the burr, so that any
stop by the force is a false one. Nothing of the force guard was tuned on these seeds.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.cases.patients import patients
from benchmarks.metric import Metric, Progress
from benchmarks.suites.implant.accepted_beds import STOPPING, AcceptedBed, rehearsed_beds
from benchmarks.suites.implant.patient_beds import with_burr
from benchmarks.suites.implant.placement import interval
from rona_core.session.document import Session

SEEDS = range(41_100, 41_160)
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
# implant -> beds of it at most, the one that the search finds among them
BEDS: Mapping[str, int] = {"BCI 602": 2, "CI receiver": 2, "Osia/Baha screw": 4}
MOST_FALSE = 0.01  # share of beds
NEAR_MM = 2.0  # of true bone: beds that leave less are told apart
SPARE_MM = 0.3  # of bone below a burr that was stopped in another bed: for nothing as well


def run(progress: Progress) -> list[Metric]:
    """Return how many stops are false."""
    found: list[AcceptedBed] = []
    mapped = 0
    for number, session in enumerate(patients(progress, SEEDS, files=FILES)):
        if session.results.maps is not None:
            found += of_patient(number, session)
            mapped += 1
    return [Metric("patients with maps", float(mapped), "patients", "higher"), *figures(found)]


def of_patient(number: int, session: Session) -> list[AcceptedBed]:
    """Return the rehearsed beds of a patient with maps; their places follow from its seed."""
    generator = np.random.default_rng(session.setup.seed)
    return list(rehearsed_beds(number, with_burr(session), BEDS, generator))


def figures(found: Sequence[AcceptedBed]) -> Iterator[Metric]:
    """Yield the figures of accepted beds."""
    kept = [one for one in found if one.kept]
    yield Metric("accepted beds rehearsed", float(len(found)), "beds", "higher")
    yield Metric("patients with one", float(len({one.patient for one in found})), "", "higher")
    searched = sum(one.searched for one in found)
    yield Metric("of these as searched", float(searched), "beds", "higher")
    yield Metric("beds that keep their limit as planned", float(len(kept)), "beds", "higher")
    least = min((one.left_mm for one in found), default=None)
    yield Metric("as planned: least true residual", least, "mm", "higher")
    near = sum(one.left_mm < NEAR_MM for one in kept)
    yield Metric(f"of these with less than {NEAR_MM:g} mm of true bone", float(near), "", "higher")
    for name in STOPPING:
        yield from _false(name, kept)
        yield from _of_implants(name, kept)
        yield from _others(name, found)


def _false(name: str, kept: Sequence[AcceptedBed]) -> Iterator[Metric]:
    """Yield how often the burr was stopped in beds that keep their limit."""
    stopped = [one for one in kept if one.guarded[name].stopped]
    count = len(kept)
    share = len(stopped) / count if kept else None
    goal = MOST_FALSE if kept else None
    title = f"{name}: false stops"
    yield Metric(f"{title} ({len(stopped)} of {count})", share, "1", "lower", goal)
    if not kept:
        return
    yield Metric(f"{title}, 95 % sure below", interval(len(stopped), count)[1], "1", "lower")
    patients, some = len({one.patient for one in kept}), len({one.patient for one in stopped})
    share = some / patients
    yield Metric(f"{title}: patients with one ({some} of {patients})", share, "1", "lower")
    most = max(one.guarded[name].most_through for one in kept)
    yield Metric(f"{name}: most that the burr was said to be through", most, "1", "lower")


def _of_implants(name: str, kept: Sequence[AcceptedBed]) -> Iterator[Metric]:
    """Yield false stops implant by implant: in the hole of a screw there is little to be felt."""
    for implant in sorted({one.implant for one in kept}):
        own = [one.guarded[name].stopped for one in kept if one.implant == implant]
        title = f"{name}, {implant}: false stops ({sum(own)} of {len(own)})"
        yield Metric(title, sum(own) / len(own), "1", "lower")


def _others(name: str, found: Sequence[AcceptedBed]) -> Iterator[Metric]:
    """Yield how the beds fared that do not keep their limit, and what was left of all."""
    broken = [one.guarded[name] for one in found if not one.kept]
    stops = [one for one in broken if one.stopped]
    early = sum(one.here_mm >= SPARE_MM for one in stops)
    title = f"{name}, {len(broken)} beds that do not keep their limit"
    yield Metric(f"{title}: stops", float(len(stops)), "beds", "lower")
    yield Metric(f"{title}: stops with {SPARE_MM:g} mm left", float(early), "beds", "lower")
    dura = sum(one.guarded[name].least_mm < 0.0 for one in found)
    yield Metric(f"{name}: dura reached", float(dura), "beds", "lower", 0.0)
    raised = sum(one.guarded[name].raised_mm > 0.0 for one in found)
    yield Metric(f"{name}: beds raised", float(raised), "beds", "lower")
