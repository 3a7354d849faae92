"""Plates in recorded lines: threshold, matched filter and `rona detect` in one table.

The recordings come from ``tests.scenes.tank_recordings``, which shares nothing with the product's
model of echoes. Threshold and matched filter are those of the original system, and are helped:
they are told where the front is to be sought and how far behind it the back wall lies.
Random windows of real records follow where these are at hand (``recorded_windows``).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.suites.ultrasound.recorded_windows import run_windows
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.thickness_figures import thickness_figures
from rona_core.ultrasound.recorded.band import Band, Complexes, analytic
from rona_core.ultrasound.recorded.plate_detector import detect_recorded
from tests.scenes.laboratory.families import FAMILIES, draw
from tests.scenes.tank_recordings import CASES, Case, Recording, record, varied

SEEDS = (21, 22, 23)  # others than those the detection was adjusted with
LABORATORY_SEEDS = range(500, 530)
WRONG_MM = 1.0
WRONG_SHARE = 0.2  # of the thickness, for thin plates
TOLD_MM = 3.0  # the older methods look this far on either side of the truth
Method = Callable[[Recording, Case], tuple[Floats, Bools]]


def run(progress: Progress) -> list[Metric]:
    """Return scatter, bias and failures of each method over all kinds of recordings."""
    methods: dict[str, Method] = {"threshold": threshold, "matched": matched, "detect": detected}
    metrics: list[Metric] = []
    spread: dict[str, list[float]] = {name: [] for name in methods}
    failed: dict[str, list[float]] = {name: [] for name in methods}
    flagged: list[float] = []
    biases: list[float] = []
    for title, case in CASES.items():
        progress(title)
        sds: dict[str, list[float]] = {name: [] for name in methods}
        for seed in SEEDS:
            one = varied(case, seed=seed)
            made = record(one)
            for name, method in methods.items():
                thickness, ok = method(made, one)
                error = thickness - made.thickness_mm
                wrong = ok & ((np.abs(error) > WRONG_MM) | ~made.contact)
                right = ok & ~wrong
                failed[name].append(float(wrong.mean()))
                if right.sum() > 2:
                    sds[name].append(_robust(error[right]))
                if name == "detect":
                    flagged.append(float((~ok & made.contact).mean()))
                    biases.append(float(np.median(error[right])) if right.any() else np.inf)
        known = {name: float(np.median(values)) for name, values in sds.items() if values}
        for name in known:
            spread[name].append(known[name])
        if "detect" in known and "threshold" in known:
            metrics.append(
                Metric(
                    f"sd_mm, {title}",
                    known["detect"],
                    "mm",
                    "lower",
                    None,
                    "threshold",
                    known["threshold"],
                )
            )
    for name in methods:
        goal = {"detect": 0.01}.get(name)
        median = float(np.median(spread[name]))
        metrics.append(Metric(f"median sd_mm, {name}", median, "mm", "lower", goal, "paper", 0.5))
        aim = {"detect": 0.01}.get(name)
        share = float(np.mean(failed[name]))
        metrics.append(Metric(f"failure_fraction, {name}", share, "share", "lower", aim))
    metrics.append(
        Metric("flagged_with_contact_fraction", float(np.mean(flagged)), "share", "lower", 0.02)
    )
    metrics.append(Metric("worst bias_mm", float(np.max(np.abs(biases))), "mm", "lower", 0.06))
    metrics += laboratories(progress)
    metrics += run_windows(progress)
    made = record(varied(CASES["plate over a floor"], scans=200))
    time = cpu_ms(lambda: detect_recorded(made.file, 2.85), repeats=2)
    metrics.append(Metric("scans_per_s", 200e3 / time, "1/s", "higher", 200.0))
    return metrics


def laboratories(progress: Progress) -> list[Metric]:
    """Return error, scatter and failures over recordings as laboratories make them, by family."""
    metrics: list[Metric] = []
    wrongs: list[float] = []
    lacks: list[float] = []
    errors: list[float] = []
    for family in FAMILIES:
        progress(f"laboratory, {family}")
        found = [_one(family, seed) for seed in LABORATORY_SEEDS]
        wrong = float(np.mean([one.wrong for one in found]))
        lacking = float(np.mean([one.lacking for one in found]))
        told = float(np.mean([abs(one.told - one.failed) for one in found]))
        wrongs.append(wrong)
        lacks.append(lacking)
        known = [one for one in found if one.error_mm is not None]
        if known:
            error = float(np.median([one.error_mm or 0.0 for one in known]))
            sd = float(np.median([one.sd_mm for one in known]))
            errors.append(error)
            metrics.append(Metric(f"|mean error| mm, {family}", error, "mm", "lower", 0.1))
            metrics.append(Metric(f"robust sd_mm, {family}", sd, "mm", "lower"))
        metrics.append(Metric(f"unflagged failures, {family}", wrong, "share", "lower", 0.05))
        metrics.append(Metric(f"flagged though readable, {family}", lacking, "share", "lower"))
        metrics.append(Metric(f"failure_fraction off truth, {family}", told, "share", "lower"))
    return [
        *metrics,
        Metric("median |mean error| mm, all", float(np.median(errors)), "mm", "lower", 0.05),
        Metric("unflagged failures, all", float(np.mean(wrongs)), "share", "lower", 0.012),
        Metric("flagged though readable, all", float(np.mean(lacks)), "share", "lower", 0.05),
    ]


@dataclass(frozen=True, slots=True)
class _Judged:
    error_mm: float | None  # of the mean thickness; None where none or nothing is to be found
    sd_mm: float
    wrong: float  # shares of scans
    lacking: float
    told: float  # failure_fraction, and what it is with the truth known
    failed: float


def _one(family: str, seed: int) -> _Judged:
    bench, made = draw(family, seed)
    found = detect_recorded(made.file, made.speed)
    ok = np.asarray(found.ok)
    figures = thickness_figures(found.thickness_mm, ok, made.file.positions_mm)
    whole = made.whole & made.audible
    off = np.abs(found.thickness_mm - made.thickness_mm)
    wrong = ok & ((off > min(WRONG_MM, WRONG_SHARE * bench.thickness_mm)) | ~whole)
    error = None
    if figures.mean_mm is not None and whole.any():
        error = abs(figures.mean_mm - float(made.thickness_mm[whole].mean()))
    return _Judged(
        error,
        figures.robust_sd_mm or 0.0,
        float(wrong.mean()),
        float((~ok & whole).mean()),
        figures.failure_fraction,
        float((wrong | ~ok).mean()),
    )


def detected(made: Recording, case: Case) -> tuple[Floats, Bools]:
    """Return thicknesses (n,) and which of them are not flagged, told nothing but the speed."""
    found = detect_recorded(made.file, case.speed)
    return np.asarray(found.thickness_mm), np.asarray(found.ok)


def threshold(made: Recording, case: Case) -> tuple[Floats, Bools]:
    """Return thicknesses by the rising edges at half of each echo's peak in the envelope."""
    return _between(made, case, np.abs(_filtered(made, case)), edges=True)


def matched(made: Recording, case: Case) -> tuple[Floats, Bools]:
    """Return thicknesses by the peaks of a filter matched to the loudest line's front."""
    z = _filtered(made, case)
    front = _first(np.abs(z), case, made)
    half = round(1.2 / (case.bandwidth * case.centre_mhz) * case.sampling_mhz)
    best = int(np.argmax(np.abs(z)[np.arange(len(z)), front]))
    start = max(0, int(front[best]) - half)
    template = z[best, start : front[best] + half]
    size = z.shape[1] + len(template)
    spectrum = np.conj(np.fft.fft(template, size))
    output = np.abs(np.fft.ifft(np.fft.fft(z, size, axis=1) * spectrum, axis=1))
    return _between(made, case, output[:, : z.shape[1]], edges=False)


def _filtered(made: Recording, case: Case) -> Complexes:
    band = Band(case.centre_mhz, case.bandwidth * case.centre_mhz)
    return analytic(made.file.rf, case.sampling_mhz, band)


def _first(envelope: Floats, case: Case, made: Recording) -> np.typing.NDArray[np.int64]:
    """Return the sample of the front's peak, sought near the stand-off."""
    start = case.start_us if not case.start_known else made.file.start_us
    spread = 4.0 * case.standoff_sd_us + 0.5
    low, high = (
        round((case.standoff_us - start + off) * case.sampling_mhz) for off in (-spread, spread + 2)
    )
    low = max(low, 0)
    return low + np.argmax(envelope[:, low:high], axis=1).astype(np.int64)


def _between(made: Recording, case: Case, level: Floats, *, edges: bool) -> tuple[Floats, Bools]:
    """Return thicknesses between the front and the largest peak within reach of the truth."""
    front = _first(level, case, made)
    step = case.sampling_mhz
    thickness = np.zeros(len(level))
    for row, first in enumerate(front):
        near = 2.0 * (made.thickness_mm[row] - TOLD_MM) / case.speed
        far = 2.0 * (made.thickness_mm[row] + TOLD_MM) / case.speed
        blank = 1.5 / (case.bandwidth * case.centre_mhz)
        low = int(first + max(near, min(blank, 0.6 * near + 0.4 * far)) * step)
        high = min(int(first + far * step), level.shape[1] - 1)
        back = low + int(np.argmax(level[row, low:high])) if high > low + 1 else low
        a, b = (_edge(level[row], k) if edges else _top(level[row], k) for k in (first, back))
        thickness[row] = (b - a) / step * case.speed / 2.0
    return thickness, np.ones(len(level), dtype=np.bool_)


def _edge(level: Floats, peak: int) -> float:
    """Return where the rise to a peak crosses half of it, in samples."""
    below = np.flatnonzero(level[:peak] < 0.5 * level[peak])
    if not len(below):
        return float(peak)
    k = int(below[-1])
    return k + float((0.5 * level[peak] - level[k]) / max(level[k + 1] - level[k], 1e-12))


def _top(level: Floats, peak: int) -> float:
    """Return the place of a peak by a parabola, in samples."""
    if not 0 < peak < len(level) - 1:
        return float(peak)
    a, b, c = level[peak - 1 : peak + 2]
    bend = a - 2.0 * b + c
    return peak + (float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0 else 0.0)


def _robust(values: Floats) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
