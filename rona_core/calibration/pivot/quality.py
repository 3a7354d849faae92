"""Quality of a pivot calibration: verdict, reasons and remedies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Floats, Ints

Verdict = Literal["good", "weak", "bad"]

GOOD_SIGMA_MM = 0.5  # predicted 3D standard deviation of the tip
BAD_SIGMA_MM = 1.0
NARROW_CONE_DEG = 10.0  # below it small systematic errors of the tracker move the tip far
USUAL_CONE_DEG = 20.0
CONES_DEG = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0)
FEW_POSES = 20
ONE_SIDED = 3.0  # swing in one plane over the swing across it
MANY_REJECTED = 0.1
TOO_MANY_REJECTED = 0.25
RUN_SHARE = 0.8  # of the rejected poses in one run: the tip has slipped
LARGE_NOISE_MM = 1.0  # of one marker; no tracker is as bad when all is well
DEPENDENT = 2.0  # poses that count as one, from which it is worth saying


@dataclass(frozen=True, slots=True)
class PivotFacts:
    """What the verdict is made of."""

    tip_sigma_mm: float
    cone_deg: float
    swing_deg: tuple[float, float]  # half-angles of the swing, weakest and strongest direction
    n: int
    n_used: int
    narrowness: int  # power of sin(cone) by which the error falls: 1, or 2 for a sphere fit
    marker_sigma_mm: float | None = None  # 3D RMS of one marker, estimated
    alike: float = 1.0  # neighbouring poses that count as one


def judge_pivot(facts: PivotFacts, rejected: Ints) -> tuple[Verdict, tuple[str, ...]]:
    """Return the verdict, and the reasons with their remedies; none if it is good.

    Args:
        facts: Figures of the fit.
        rejected: Rows of the poses that disagree with the tip (not those excluded by hand).
    """
    reasons: list[str] = []
    bad = False
    sigma = facts.tip_sigma_mm
    if sigma > GOOD_SIGMA_MM:
        bad = sigma > BAD_SIGMA_MM
        reasons.append(
            f"the tip is known to {sigma:.2g} mm only, {GOOD_SIGMA_MM:g} mm are wanted: "
            f"{_remedy(facts)}"
        )
        if facts.alike > DEPENDENT:
            reasons.append(
                f"about {facts.alike:.0f} neighbouring poses share their error and count as one: "
                "swing to more different poses rather than slower"
            )
    if facts.cone_deg < NARROW_CONE_DEG:
        reasons.append(
            f"a cone of {facts.cone_deg:.0f} degrees is too narrow: sweep to "
            f"{USUAL_CONE_DEG:.0f} degrees"
        )
    weakest, strongest = facts.swing_deg
    if strongest > ONE_SIDED * weakest:
        reasons.append(
            f"the swing stays nearly in one plane ({strongest:.0f} degrees one way, "
            f"{weakest:.0f} across): swing across it as well"
        )
    if facts.n_used < FEW_POSES:
        reasons.append(f"only {facts.n_used} poses count: record at least {FEW_POSES}")
    share = len(rejected) / facts.n
    if share > MANY_REJECTED:
        bad = bad or share > TOO_MANY_REJECTED
        reasons.append(_rejection(rejected, facts.n))
    scatter_mm = facts.marker_sigma_mm or 0.0
    if scatter_mm > LARGE_NOISE_MM:
        bad = bad or scatter_mm > 2.0 * LARGE_NOISE_MM
        reasons.append(
            f"the tip scatters as if a marker erred by {scatter_mm:.2g} mm: check the marker "
            "geometry, and that the tip rests firmly"
        )
    if bad:
        return "bad", tuple(reasons)
    return ("weak", tuple(reasons)) if reasons else ("good", ())


def _remedy(facts: PivotFacts) -> str:
    """Return the cone, or the number of poses at the widest cone, that would be enough."""
    wider = [pair for pair in predicted_by_cone(facts) if pair[0] > facts.cone_deg]
    enough = [cone_deg for cone_deg, sigma in wider if sigma <= GOOD_SIGMA_MM]
    if enough:
        return f"sweep to {enough[0]:.0f} degrees instead of {facts.cone_deg:.0f}"
    cone_deg, sigma = wider[-1] if wider else (facts.cone_deg, facts.tip_sigma_mm)
    times = np.ceil(10.0 * (sigma / GOOD_SIGMA_MM) ** 2) / 10.0
    many = f"record {times:.1f} times as many poses"
    return f"sweep to {cone_deg:.0f} degrees and {many}" if wider else many


def predicted_by_cone(facts: PivotFacts) -> tuple[tuple[float, float], ...]:
    """Return pairs of half-angle (deg) and the tip's predicted error (mm) for as many poses.

    The error falls with the sine of the half-angle, in a sphere fit with its square.
    """
    now = np.sin(np.deg2rad(facts.cone_deg))
    return tuple(
        (cone, facts.tip_sigma_mm * float(now / np.sin(np.deg2rad(cone))) ** facts.narrowness)
        for cone in CONES_DEG
    )


def _rejection(rejected: Ints, n: int) -> str:
    """Say how many poses were rejected, and whether they follow on one another."""
    first, last = longest_run(rejected)
    if last - first + 1 >= RUN_SHARE * len(rejected) and len(rejected) > 2:
        return (
            f"{len(rejected)} of {n} poses are rejected, nearly all from {first} to {last}: "
            "the tip slipped there; hold it down and swing again"
        )
    return (
        f"{len(rejected)} of {n} poses are rejected: look for reflections, hidden markers or a "
        "tip that does not rest firmly"
    )


def longest_run(rows: Sequence[int] | Ints) -> tuple[int, int]:
    """Return first and last of the longest run of rows that follow one another (gaps of 1)."""
    values = np.asarray(rows, dtype=np.int64)
    starts = np.flatnonzero(np.diff(values, prepend=values[0] - 9) > 2)
    ends = np.append(starts[1:], len(values)) - 1
    best = int((values[ends] - values[starts]).argmax())
    return int(values[starts[best]]), int(values[ends[best]])


def correlated_poses(residuals: Floats) -> float:
    """Return how many neighbours in a series of residual vectors (n, 3) count as one pose.

    One plus twice the sum of the autocorrelations up to the first that is lost in the noise; 1 for
    a series without memory. At most n / 6.
    """
    n = len(residuals)
    power = float((residuals**2).sum())
    if n < 12 or power <= 0.0:
        return 1.0
    lost = 2.0 / np.sqrt(3.0 * n)
    total = 1.0
    for lag in range(1, n // 2):
        alike = float((residuals[:-lag] * residuals[lag:]).sum()) / power
        if alike < (2.0 * lost if lag == 1 else lost):
            break
        total += 2.0 * alike
    return min(total, n / 6.0)
