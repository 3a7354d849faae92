"""Thickness of a bone plate by each way of detection, beside the paper's 0.5 mm.

The plate is 6 mm thick with a diploe of 2.5 mm; its inner face is tilted as inner tables are, the
probe is off by half a millimetre and by 1.5 degrees.
"""

from collections.abc import Iterator
from typing import Literal, get_args

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import Excitation, ProbeSettings
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock

Method = Literal["subtract", "matched", "threshold"]

SHOTS = 150
THICKNESS_MM, TABLE_MM, DIPLOE_MM = 6.0, 2.0, 2.5
PROBE_TILT_DEG, MISPLACEMENT_MM = 1.5, 0.5
INNER_TILTS_DEG = (0.0, 7.0)  # along the plate's normal, and the median of real inner tables
WRONG_MM = 1.0
FACET_MM = 40.0  # each shot has a facet of the inner face for itself


class Plate:
    """A layered plate; frame ``skull`` has z down into it, the outer face at z = 0."""

    def __init__(self, inner_tilt_deg: float) -> None:
        """Take the tilt of the inner face about y."""
        self._slope = np.tan(np.deg2rad(inner_tilt_deg))

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return distances (n, 4) along rays to the four boundaries."""
        down = directions_skull[:, 2]
        outer = -origins_skull[:, 2] / down
        x = (origins_skull + outer[:, None] * directions_skull)[:, 0]
        inner = self._inner(x) - origins_skull[:, 2]
        depths = (0.0, TABLE_MM, TABLE_MM + DIPLOE_MM)
        return np.column_stack([*((z - origins_skull[:, 2]) / down for z in depths), inner / down])

    def _inner(self, x_mm: Floats) -> Floats:
        center = np.rint(x_mm / FACET_MM) * FACET_MM  # one facet a shot, centred under it
        return THICKNESS_MM + self._slope * (x_mm - center)


def run(progress: Progress) -> list[Metric]:
    """Return bias, scatter and failures of the thickness for each method."""
    metrics: list[Metric] = []
    for tilt in INNER_TILTS_DEG:
        for excitation in get_args(Excitation):
            progress(f"{SHOTS} shots, {excitation}, inner face tilted by {tilt:.0f} degrees")
            track = shots(tilt, excitation)
            for method in get_args(Method):
                metrics += figures(track, tilt, excitation, method)
    return metrics


def poses(rng: np.random.Generator) -> Iterator[Pose]:
    """Yield ``T_skull_probe`` over places on the plate, slightly off and slightly tilted."""
    for shot in range(SHOTS):
        turn = np.append(rng.normal(0.0, np.deg2rad(PROBE_TILT_DEG) / np.sqrt(2.0), 2), 0.0)
        off = rng.uniform(-MISPLACEMENT_MM, MISPLACEMENT_MM)
        yield Pose.from_rotvec(turn, (FACET_MM * shot, 0.0, -off))


def shots(tilt_deg: float, excitation: Excitation) -> AScanTrack:
    """Return A-scans of the plate."""
    clock = CaptureClock()
    places = list(poses(np.random.default_rng(5)))
    here = [places[0]]
    probe = VirtualProbe(clock, lambda times: here[0].repeated(len(times)), Plate(tilt_deg))
    probe.begin(ProbeSettings(excitation=excitation), 5, 0)
    scans: list[AScan] = []
    for number, place in enumerate(places):
        here[0] = place
        clock.wait_until(0.01 * (number + 1))
        scans.append(probe.acquire())
    return AScanTrack.from_scans(scans)


def figures(
    track: AScanTrack, tilt_deg: float, excitation: Excitation, method: Method
) -> list[Metric]:
    """Return the figures of one method on one set of A-scans."""
    found = detect(ProbeSurvey(track, probe_model("2.25MHz"), excitation), method=method)
    ok = np.asarray(found.inner_ok) & (np.asarray(found.flag) == 0)
    error = np.asarray(found.thickness_mm)[ok] - THICKNESS_MM
    right = np.abs(error) <= WRONG_MM
    label = f"{method}, {excitation}, {tilt_deg:.0f} deg"
    product = method == "subtract"
    scatter = float(error[right].std()) if right.sum() > 1 else None
    wrong = float((~right).mean()) if len(error) else None
    return [
        Metric(
            f"thickness_sd_mm, {label}",
            scatter,
            "mm",
            "lower",
            0.5 if product else None,
            "paper",
            0.5,
        ),
        Metric(f"flagged_fraction, {label}", float(1.0 - ok.mean()), "share", "lower"),
        Metric(
            f"unflagged_failure_fraction, {label}",
            wrong,
            "share",
            "lower",
            0.1 if product else None,
        ),
    ]
