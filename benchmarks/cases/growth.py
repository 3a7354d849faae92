"""Growth of CPU time with the amount of work: the same work on twice as much, three times over."""

import math
from collections.abc import Callable, Sequence
from itertools import islice
from time import process_time

import numpy as np

from benchmarks.metric import Metric
from benchmarks.timed_procedure import NOMINAL_SETUP
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.derivation import DETECTION, HELD_PROBE
from rona_core.app.steps.path.inputs import SMOOTHING
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.inputs import DRIVEN
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.derivation import POSES, SCAN
from rona_core.compose import build_virtual_rig
from rona_core.devices.samples import AScanTrack
from rona_core.geometry.path5d import Path5D
from rona_core.mapping.build_maps import LocatedDetection, build_maps
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.session.document import Session
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey
from rona_core.virtual.rig import VirtualRig

DOUBLED = (1, 2, 4, 8)
EXPONENT = 1.1
ROUNDS = 3  # of which the fastest counts
FRAMES, CELL_MM = 512, 1.0  # the least work
PATH_PART = 4  # of the session's path, which is taken once, twice, ... eight times


def exponent(amounts: Sequence[float], times_s: Sequence[float]) -> float:
    """Return the slope of the logarithm of times (n,) over that of amounts (n,)."""
    return float(np.polyfit(np.log(amounts), np.log(times_s), 1)[0])


def growth(name: str, amounts: Sequence[float], work: Callable[[int], object]) -> Metric:
    """Return how the time of ``work(i)`` grows with ``amounts[i]``."""
    best = np.full(len(amounts), np.inf)
    for _ in range(ROUNDS):  # one amount after the other, so that a busy moment meets all
        for i in range(len(amounts)):
            start = process_time()
            work(i)
            best[i] = min(best[i], process_time() - start)
    where = f"{amounts[0]:g} to {amounts[-1]:g}"
    return Metric(
        f"exponent of cost, {name} ({where})",
        exponent(amounts, best.tolist()),
        "",
        "lower",
        EXPONENT,
    )


def growths(session: Session) -> list[Metric]:
    """Return the exponents; of the session, a whole procedure, path, scan and maps are used."""
    return [_frames(), _path_length(session), _scans(session), _cells(session)]


def tracker_frames(rig: VirtualRig, n: int) -> None:
    """Measure ``n`` frames of five tools while the pointer slides over the skull."""
    rig.begin(rig.scene.settings, 1)
    rig.operator.sweep(duration_s=n / rig.scene.settings.tracker.rate_hz)
    for _ in islice(rig.tracker.frames(), n):
        pass


def _frames() -> Metric:
    rig = build_virtual_rig(NOMINAL_SETUP)
    amounts = [FRAMES * times for times in DOUBLED]
    return growth("number of frames", amounts, lambda i: tracker_frames(rig, amounts[i]))


def _path_length(session: Session) -> Metric:
    """Plan the beginning of the session's path, there and back as often as the length asks for."""
    path = required(SMOOTHING, session).path
    model = robot_model(session.setup.devices.robot.model)
    settings = plan_settings(required(DRIVEN, session), StartRollSearch())
    there = np.arange(max(2, len(path) // PATH_PART))
    back = there[::-1]
    paths: list[Path5D] = []
    for times in DOUBLED:
        order = np.concatenate(
            [there, *((there if k % 2 == 0 else back)[1:] for k in range(1, times))]
        )
        paths.append(Path5D(path.points_base[order], path.axes_base[order]))
    lengths_mm = [float(one.arc_length_mm()[-1]) for one in paths]
    return growth("path length", lengths_mm, lambda i: plan_scan(paths[i], model, settings))


def _scans(session: Session) -> Metric:
    scans, poses = required(SCAN, session).scans, required(POSES, session)
    devices = session.setup.devices.probe
    amounts = [len(scans) // DOUBLED[-1] * times for times in DOUBLED]

    def find(i: int) -> Detection:
        some = slice(0, amounts[i])
        track = AScanTrack(
            scans.times_s[some],
            scans.rf[some],
            scans.sampling_mhz,
            scans.start_us,
            scans.clipped[some],
        )
        there = poses.select(some)
        return detect(
            ProbeSurvey(
                track,
                required(HELD_PROBE, session),
                devices.excitation,
                positions_mm=there.translations,
                axes=there.rotations[:, :, 2],
            )
        )

    return growth("A-scans", amounts, find)


def _cells(session: Session) -> Metric:
    detection = required(DETECTION, session)
    found = LocatedDetection(detection, required(POSES, session))
    widths_mm = [CELL_MM / math.sqrt(times) for times in DOUBLED]
    amounts = [int(build_maps(found, cell_mm=width).outer.ok.sum()) for width in widths_mm]
    return growth("map cells", amounts, lambda i: build_maps(found, cell_mm=widths_mm[i]))
