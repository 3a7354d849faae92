"""Thickness from end to end with a speed of sound of the patient's own, as each patient has one.

The whole procedure with virtual devices over seeds, one pass: with the published speed, with that
calibrated at one, three and five places by caliper, and, to compare, of a patient whose speed is
nominal. ``scan_thickness`` is that of the sure A-scans, along the axis, without those that
took another echo; ``thickness`` that of the map, with whatever went wrong. Original
system: 0.5 mm.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from benchmarks.metric import Metric, Progress, over_seeds
from rona_core.app.procedure import PROCEDURE, run_procedure
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import SetBoneModel, SetSeed
from rona_core.compose import new_workbench
from rona_core.errors import RonaError
from rona_core.session.document import Session

SEEDS = range(8)
POINTS = (1, 3, 5)
GOALS = {"published speed": 0.30, "3 points": 0.20}
ONE_PASS = tuple(step for step in PROCEDURE if step[0] != "second")
KEYS = (
    "scan_thickness_rms_mm",
    "thickness_rms_mm",
    "thickness_bias_mm",
    "sound_speed_error_percent",
)


@dataclass(slots=True)
class Runs:
    """Figures by way, one for each patient."""

    figures: dict[str, list[dict[str, float | None]]] = field(default_factory=dict)

    def add(self, way: str, bench: Workbench) -> None:
        """Keep the figures of the map as it is now."""
        found = bench.figures()
        names = (*KEYS, "thickness_sigma_predicted_mm")
        self.figures.setdefault(way, []).append({name: found.get(name) for name in names})

    def values(self, way: str, key: str) -> list[float]:
        """Return one figure of every patient that has it."""
        known = (found[key] for found in self.figures.get(way, []))
        return [float(value) for value in known if value is not None]


def run(progress: Progress) -> list[Metric]:
    """Return RMS, bias and error of the speed, way by way."""
    runs, done = Runs(), 0
    for seed in SEEDS:
        progress(f"seed {seed}")
        done += sum(1 for _ in ways(seed, runs))
    metrics: list[Metric] = []
    for way in runs.figures:
        pooled = None
        for key in ("thickness_rms_mm", "scan_thickness_rms_mm"):
            squares = np.square(runs.values(way, key))
            pooled = float(np.sqrt(squares.mean())) if len(squares) else None
            goal = GOALS.get(way) if key.startswith("scan") else None
            name = f"{key}, {way}"
            metrics.append(Metric(f"{name}, pooled", pooled, "mm", "lower", goal, "paper", 0.5))
            metrics += over_seeds(name, runs.values(way, key), "mm", "lower")
        bias = [abs(value) for value in runs.values(way, "thickness_bias_mm")]
        metrics += over_seeds(f"abs_thickness_bias_mm, {way}", bias, "mm", "lower")
        off = [abs(value) for value in runs.values(way, "sound_speed_error_percent")]
        metrics += over_seeds(f"abs_speed_error_percent, {way}", off, "%", "lower")
        expected = np.square(runs.values(way, "thickness_sigma_predicted_mm"))
        if pooled is not None and len(expected):
            share = pooled / float(np.sqrt(expected.mean()))
            metrics.append(Metric(f"error_over_predicted, {way}", share, "1", "lower"))
    return [*metrics, Metric("maps", float(done), "", "higher")]


def ways(seed: int, runs: Runs) -> Iterator[str]:
    """Yield every way that gave a map of one patient."""
    bench = new_workbench(Session(name=f"thickness, seed {seed}"))
    try:
        bench.dispatch(SetSeed(seed))
        if not run_procedure(bench, messages=ONE_PASS).completed:
            return
        runs.add("published speed", bench)
        yield "published speed"
        for points in POINTS:
            try:
                bench.run(StartCaliperMeasurements(n=points))
            except RonaError:
                continue
            bench.run(StartMapping())
            runs.add(f"{points} points", bench)
            yield f"{points} points"
        bench.dispatch(SetBoneModel(own_speed=False))
        bench.run(StartScan())
        bench.run(StartMapping())
        runs.add("nominal patient", bench)
        yield "nominal patient"
    finally:
        bench.close()
