"""Thickness from end to end in the realistic world, with reference points and without.

The whole procedure with virtual devices over seeds that nothing was tuned with, one pass: at the
published speed of sound, and at that calibrated at three places that the program proposes.
``scan_thickness`` is that of the sure A-scans, along the axis, without those that took another
echo; ``thickness`` that of the map, with whatever went wrong. Original system: 0.5 mm.
"""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.metric import Metric, Progress, over_seeds
from benchmarks.reference.map_coverage import bands, within
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.setup.messages import SetSeed, SetWorld
from rona_core.compose import new_workbench
from rona_core.devices.world_settings import WorldProfile
from rona_core.errors import RonaError
from rona_core.session.document import Session

SEEDS = range(31_000, 31_024)
PROFILE: WorldProfile = "realistic"
PUBLISHED, MEASURED = "published speed", "3 reference points"
GOALS = {PUBLISHED: 0.40, MEASURED: 0.28}  # of the map, median over patients, in mm
ONE_PASS = stages("detection")
KEYS = (
    "thickness_rms_mm",
    "scan_thickness_rms_mm",
    "thickness_bias_mm",
    "sound_speed_error_percent",
)


@dataclass(slots=True)
class Runs:
    """Figures by way, one for each patient."""

    figures: dict[str, list[dict[str, float]]] = field(default_factory=dict)
    refused: dict[str, int] = field(default_factory=dict)

    def add(self, way: str, bench: Workbench) -> None:
        """Keep the figures of the map as it is now."""
        found = bench.figures()
        kept = {name: float(found[name]) for name in KEYS if found.get(name) is not None}
        for name, band in bands(bench.session):
            if name == "thickness":
                kept["within"] = within(band.errors_mm, band.total_mm)
                kept["predicted"] = float(np.sqrt(np.mean(band.total_mm**2)))
        self.figures.setdefault(way, []).append(kept)

    def refuse(self, way: str) -> None:
        """Count a patient of whom there is no map this way."""
        self.refused[way] = self.refused.get(way, 0) + 1

    def values(self, way: str, key: str) -> list[float]:
        """Return one figure of every patient that has it."""
        return [found[key] for found in self.figures.get(way, []) if key in found]


def run(progress: Progress) -> list[Metric]:
    """Return errors of thickness and speed beside what was predicted, way by way."""
    runs = Runs()
    for seed in SEEDS:
        progress(f"seed {seed}")
        one_patient(seed, runs)
    return [metric for way in (PUBLISHED, MEASURED) for metric in figures(way, runs)]


def one_patient(seed: int, runs: Runs) -> None:
    """Map one patient with the published speed, then with reference points."""
    bench = new_workbench(Session(name=f"thickness, seed {seed}"))
    try:
        bench.dispatch(SetSeed(seed))
        bench.dispatch(SetWorld(profile=PROFILE))
        if not run_procedure(bench, ONE_PASS).completed:
            runs.refuse(PUBLISHED)
            runs.refuse(MEASURED)
            return
        runs.add(PUBLISHED, bench)
        try:
            bench.run(StartCaliperMeasurements())
        except RonaError:
            runs.refuse(MEASURED)
            return
        bench.run(StartMapping())
        runs.add(MEASURED, bench)
    finally:
        bench.close()


def figures(way: str, runs: Runs) -> list[Metric]:
    """Return the figures of one way over all patients."""
    errors = runs.values(way, "thickness_rms_mm")
    predicted = runs.values(way, "predicted")
    bias = [abs(value) for value in runs.values(way, "thickness_bias_mm")]
    off = [abs(value) for value in runs.values(way, "sound_speed_error_percent")]
    held = runs.values(way, "within")
    share = float(np.mean(held)) if held else None
    return [
        *over_seeds(f"thickness_rms_mm, {way}", errors, "mm", "lower", goal=GOALS[way]),
        Metric(f"thickness_rms_mm, {way}, pooled", pooled(errors), "mm", "lower", None),
        Metric(f"thickness predicted, {way}, pooled", pooled(predicted), "mm", "lower", None),
        Metric(f"thickness within the 95 % band, {way}", share, "share", "higher", 0.90),
        *over_seeds(
            f"scan_thickness_rms_mm, {way}",
            runs.values(way, "scan_thickness_rms_mm"),
            "mm",
            "lower",
        ),
        *over_seeds(f"abs_thickness_bias_mm, {way}", bias, "mm", "lower"),
        *over_seeds(f"abs_speed_error_percent, {way}", off, "%", "lower"),
        Metric(f"maps, {way}", float(len(errors)), "", "higher"),
        Metric(f"refused, {way}", float(runs.refused.get(way, 0)), "", "lower"),
    ]


def pooled(values: list[float]) -> float | None:
    """Return the RMS over patients."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else None
