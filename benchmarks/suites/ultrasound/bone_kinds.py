"""Whole scans of patients of every kind of bone: what is kept is right, and how much that is.

The robot scans each patient once; then the virtual probe fires again at the same places into hard
and sharp bone, and into bone that loses less and more than the nominal one. Nothing was tuned with
these patients. A boundary is wrong that is off by more than 1 mm at the nominal speed.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.session.specimen import BoneKind
from tests.scenes.bone_surveys import Survey, detected, fired_again, scanned

SEEDS = range(42_000, 42_012)  # never tuned with; tuned with were 20000 to 20003, 41000 to 41003
WRONG_MM = 1.0
GOAL = 0.02  # of what is kept
WORLDS: tuple[tuple[BoneKind, float, int], ...] = (  # kind, loss over nominal, patients
    ("hard", 1.0, 12),
    ("sharp", 1.0, 12),
    ("normal", 1.0, 4),
    ("hard", 0.75, 4),
    ("sharp", 0.75, 4),
    ("hard", 1.5, 4),
    ("sharp", 1.5, 4),
)


@dataclass(frozen=True, slots=True)
class Kept:
    """Of one survey."""

    scans: int
    kept: int
    wrong: int  # of those kept


def run(progress: Progress) -> list[Metric]:
    """Return failures without a flag and coverage, kind by kind and loss by loss."""
    surveys: list[Survey] = []
    for seed in SEEDS:
        progress(f"the scan of seed {seed}")
        surveys.append(scanned(seed))
    metrics: list[Metric] = []
    for kind, loss, n in WORLDS:
        label = f"{kind} bone, loss x{loss:g}"
        progress(label)
        metrics += figures(label, [judged(survey, kind, loss) for survey in surveys[:n]])
    return metrics


def judged(survey: Survey, kind: BoneKind, loss: float) -> Kept:
    """Return what is kept of one survey in such bone, and what of that is wrong."""
    scene = fired_again(survey, kind, loss)
    found = detected(survey, scene)
    true_mm = scene.bone_us * found.sound_speed_mm_per_us / 2.0
    wrong = np.abs(found.thickness_mm - true_mm) > WRONG_MM
    return Kept(len(scene), int(found.inner_ok.sum()), int((wrong & found.inner_ok).sum()))


def figures(label: str, all_kept: list[Kept]) -> list[Metric]:
    """Return the figures of some surveys: pooled, and of the worst of them."""
    shares = [each.wrong / each.kept for each in all_kept if each.kept]
    total = sum(each.kept for each in all_kept)
    pooled = sum(each.wrong for each in all_kept) / total if total else None
    worst = max(shares) if shares else None
    coverage = [each.kept / each.scans for each in all_kept]
    mean = total / sum(each.scans for each in all_kept)
    return [
        Metric(f"unflagged_failures, {label}", pooled, "share", "lower", GOAL if total else None),
        Metric(f"unflagged_failures of the worst seed, {label}", worst, "share", "lower"),
        Metric(f"coverage, {label}", mean, "share", "higher"),
        Metric(f"coverage of the worst seed, {label}", min(coverage), "share", "higher"),
    ]
