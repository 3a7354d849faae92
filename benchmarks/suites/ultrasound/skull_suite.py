"""Detection method by method: plate against the bound, skull, hard and anatomical suites.

The scenes are those that nothing was tuned with. Errors are of the time of flight, stated as
thickness at the nominal speed; a failure is one of more than 1 mm. ``threshold`` and ``matched``
are the methods of the original system.
"""

from time import process_time
from typing import Literal, get_args

import numpy as np
from scipy.stats import rankdata

from benchmarks.metric import Metric, Progress
from benchmarks.reference.echo_timing import inner_bound, peak_times
from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, Detection, detect
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.scenes.bone_record import BoneScene
from tests.scenes.bone_scenes import anatomical_bone, hard_bone, parallel_bone, plate

Method = Literal["subtract", "matched", "threshold"]
WRONG_MM = 1.0
PLATE_MM, PLATE_SNRS_DB, PLATE_SCANS = 6.0, (20.0, 30.0, 40.0), 150
SKULL_MM = {"2.25MHz": (3.0, 5.0, 7.0, 10.0), "1MHz": (4.5, 6.0, 8.0, 10.0)}
HARD_MM, HARD_SIDE = (5.0, 7.0), 16  # scans along each side
PATIENTS, REGION_MM = (0, 1, 2), 20.0
NAMES = tuple(SKULL_MM)
EXCITATIONS: tuple[Excitation, ...] = get_args(Excitation)
SD_GOAL_MM = {"2.25MHz": 0.05, "1MHz": 0.12}
BATCH = 2048


def run(progress: Progress) -> list[Metric]:
    """Return the figures of all suites, and the speed of matched filtering."""
    metrics: list[Metric] = []
    for name in NAMES:
        for excitation in EXCITATIONS:
            kind = f"{name} {excitation}"
            progress(f"plate, {kind}")
            metrics += plate_figures(name, excitation)
            suites = {
                "skull": [
                    s
                    for mm in SKULL_MM[name]
                    for s in parallel_bone(
                        mm, name=name, excitation=excitation, patches=1, nominal=False
                    )
                ],
                "hard": [
                    hard_bone(mm, side=HARD_SIDE, name=name, excitation=excitation, nominal=False)
                    for mm in HARD_MM
                ],
                "anatomical": [
                    anatomical_bone(
                        p, name=name, excitation=excitation, radius_mm=REGION_MM, nominal=False
                    )
                    for p in PATIENTS
                ],
            }
            for suite, scenes in suites.items():
                for method in get_args(Method):
                    progress(f"{suite}, {kind}, {method}")
                    metrics += suite_figures(suite, scenes, method)
    return [*metrics, speed()]


def plate_figures(name: str, excitation: Excitation) -> list[Metric]:
    """Return the scatter on a plate over the coherent bound.

    The ratio of signal to noise is that of a pulse in the band of the probe; a chirp is sent in the
    same noise, and its bound is that of the chirp. The bound is that of the echo that is there: of
    this probe's pulse, off this bone.
    """
    found: list[Metric] = []
    for snr in PLATE_SNRS_DB:
        scene = plate(PLATE_MM, snr, n=PLATE_SCANS, name=name, excitation=excitation, nominal=False)
        pulse, sent = (block_template(scene.probe, kind) for kind in ("pulse", excitation))
        bound = inner_bound(pulse, scene.medium.table, PLATE_MM, snr, sent).coherent_us
        bound_mm = bound * NOMINAL_SPEED_MM_PER_US / 2.0
        for method in get_args(Method):
            error, _ = errors(scene, method, bone_loss=1.0)
            kept = error[np.abs(error) <= WRONG_MM]
            label = f"{name} {excitation} {snr:.0f} dB {method}"
            ratio = float(kept.std() / bound_mm) if len(kept) > 1 else None
            goal = 1.5 if method == "subtract" else None
            found.append(Metric(f"plate sd_over_bound, {label}", ratio, "1", "lower", goal))
            failed = float(np.mean(np.abs(error) > WRONG_MM))
            found.append(Metric(f"plate failures, {label}", failed, "share", "lower"))
    return found


def errors(
    scene: BoneScene, method: Method, *, bone_loss: float | None = None
) -> tuple[Floats, Detection]:
    """Return the errors (n,) of the time of flight as thickness, and the detection.

    ``bone_loss`` is that of the bone where it is told; None: learned.
    """
    found = detect(
        ProbeSurvey(
            scene.track, scene.probe, scene.settings.excitation, positions_mm=scene.points_skull
        ),
        method=method,
        bone_loss=bone_loss,
    )
    true_mm = scene.bone_us * found.sound_speed_mm_per_us / 2.0
    return found.thickness_mm - true_mm, found


def suite_figures(suite: str, scenes: list[BoneScene], method: Method) -> list[Metric]:
    """Return scatter, bias, failures, coverage and calibration over some scenes."""
    pairs = [errors(scene, method) for scene in scenes]
    error = np.concatenate([p[0] for p in pairs])
    ok: Bools = np.concatenate([p[1].inner_ok for p in pairs])
    quality = np.concatenate([p[1].inner_quality for p in pairs])
    sigma = np.concatenate([p[1].thickness_sigma_mm for p in pairs])
    resolved: Bools = np.concatenate([_resolved(scene) for scene in scenes])
    wrong = np.abs(error) > WRONG_MM
    right = ok & ~wrong
    ours = method == "subtract"
    name = scenes[0].settings.name
    label = f"{name} {scenes[0].settings.excitation} {method}"

    def figure(
        what: str, value: float | None, unit: str, goal: float | None, *, higher: bool = False
    ) -> Metric:
        direction = "higher" if higher else "lower"
        return Metric(f"{suite} {what}, {label}", value, unit, direction, goal if ours else None)

    spread = float(error[right].std()) if right.sum() > 1 else None
    bias = float(np.abs(error[right].mean())) if right.any() else None
    missed = float(wrong[ok].mean()) if ok.any() else None
    skull, hard, anatomical = (suite == s for s in ("skull", "hard", "anatomical"))
    figures = [
        figure("sd_mm", spread, "mm", SD_GOAL_MM[name] if skull else None),
        figure("abs_bias_mm", bias, "mm", 0.03 if skull else None),
        figure("failures", float(wrong.mean()), "share", 0.01 if skull else 0.05 if hard else None),
        figure("unflagged_failures", missed, "share", 0.02 if anatomical else 0.0),
        figure("coverage", float(ok.mean()), "share", 0.6 if anatomical else None, higher=True),
        figure("coverage_of_resolved", _share(ok, resolved), "share", None, higher=True),
        figure("quality_auc", area(quality, ~wrong), "1", None, higher=True),
    ]
    if ours and right.any():
        z = float(np.sqrt(np.mean((error[right] / sigma[right]) ** 2)))
        figures.append(figure("error_over_sigma_rms", z, "1", None))
    return figures


def _resolved(scene: BoneScene) -> Bools:
    """Return which of the A-scans (n,) stand on bone of a thickness that the probe resolves."""
    low, high = scene.probe.min_thickness_mm, scene.probe.max_thickness_mm
    return np.asarray((scene.thickness_mm >= low) & (scene.thickness_mm <= high))


def _share(kept: Bools, among: Bools) -> float | None:
    return float(kept[among].mean()) if among.any() else None


def area(score: Floats, good: Bools) -> float | None:
    """Return the area under the ROC of a score that should be high for the good ones."""
    n, m = int(good.sum()), int((~good).sum())
    if not n or not m:
        return None
    return float((rankdata(score)[good].sum() - n * (n + 1) / 2.0) / (n * m))


def speed() -> Metric:
    """Return how many scans a second a batch of matched filters does, in single precision."""
    template = block_template(probe_model("2.25MHz"), "chirp")
    rf = np.random.default_rng(1).normal(size=(BATCH, 1024)).astype(np.float32)
    times: list[float] = []
    for _ in range(5):
        start = process_time()
        peak_times(template, rf)
        times.append(process_time() - start)
    return Metric("matched_scans_per_s", BATCH / min(times), "1/s", "higher", 50_000.0)
