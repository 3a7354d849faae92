"""What the pictures of the A-scans show: one of them, all side by side, and where they were taken.

``first`` is the scan of step 8, ``second`` all further passes, one after the other, ``hand`` is the
scan by hand. Times are in µs from the emission.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.view import speed_of_maps
from rona_core.app.steps.boundaries.step import detection_of_scan, scans_of
from rona_core.app.steps.handheld.derivation import HAND_POSES
from rona_core.app.steps.scan.derivation import PLACES, POSES, joined_poses
from rona_core.app.steps.scan.planned_motion import replayed
from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import boundary_points
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    speed_at,
    speed_uncertainty,
    uncalibrated,
)
from rona_core.ultrasound.detection.ascan_curves import ScanImage, preview, scan_image
from rona_core.ultrasound.detection.detect import Detection, nominal_bone
from rona_core.ultrasound.detection.manual_corrections import ScanName
from rona_core.ultrasound.detection.single.front_echo import gate_us
from rona_core.ultrasound.detection.single.inner_echo import bone_gate_us
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model

BONE_US = 12.0  # two-way time in which the inner boundary is looked for, for the eye
WORTH_TELLING = 0.02  # probability of another echo
FLAGS = (
    "both boundaries found",
    "no front echo: the probe had no contact",
    "no inner echo: a leaning inner table, thick bone and lossy bone look alike",
    "clipped: turn the gain down",
    "echo nearer than the probe resolves: thin bone or a step within it",
    "echo deeper than the probe reaches: thick bone or a multiple echo",
    "unsure which echo is the inner boundary",
    "the probe leaned too far",
    "taken away by hand",
    "the tracker did not see the probe: in no map",
)  # by the codes of `Detection.flag`


@dataclass(frozen=True, slots=True, eq=False)
class AScanPlot:
    """One A-scan and what was found in it; curves are shares of their own largest value."""

    number: int  # from 0
    time_us: Floats
    rf: Floats
    envelope: Floats
    compressed: Floats  # envelope behind the matched filter, 1 at its largest
    behind_front: Floats  # the same without the front echo, 1 at its largest
    outer_us: float | None  # None: none that counts
    inner_us: float | None
    remark: str
    outer_sigma_us: float = 0.0
    inner_sigma_us: float = 0.0
    alternative_us: float | None = None  # the other echo that may be the inner boundary
    guess_us: float | None = None  # where the inner one would be, if it does not count
    front_gate_us: tuple[float, float] | None = None  # where the front echo is looked for
    bone_gate_us: tuple[float, float] | None = None  # and the inner one
    end_us: float | None = None  # no inner boundary comes later; None: not known
    fine: bool = True  # what was found counts
    by_hand: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ScanPicture:
    """All A-scans of a pass side by side."""

    image: ScanImage
    path_mm: Floats  # (n,) way of the probe to each A-scan

    def __len__(self) -> int:
        return len(self.path_mm)


def scan_poses(session: Session, scan: ScanName = "first") -> Poses | None:
    """Return where the probe was at each A-scan, in ``base``; None before the scan.

    In a scan by hand without a place of the robot, the marker on its base is ``base``.
    """
    captures = session.captures
    if scan == "hand":
        found = HAND_POSES.read(session)
        return None if found is None else found[1]
    if captures.scan is None or not len(captures.scan.scans):
        return None
    if scan == "first":
        return required(POSES, session)
    return joined_poses(required(PLACES, session), captures.second) if captures.second else None


def scan_number_at(session: Session, share: float, scan: ScanName = "first") -> int | None:
    """Return the number of the A-scan nearest to a share of the planned motion.

    By hand, where nothing was planned, it is a share of the time that the scan took.
    """
    taken = _times_s(session, scan)
    return None if taken is None else int(np.argmin(np.abs(taken[0] - share * taken[1])))


def share_of_scan(session: Session, number: int, scan: ScanName = "first") -> float | None:
    """Return the share of the planned motion, or of a scan by hand, that an A-scan was taken at."""
    taken = _times_s(session, scan)
    if taken is None or not 0 <= number < len(taken[0]):
        return None
    return float(np.clip(taken[0][number] / max(taken[1], 1e-9), 0.0, 1.0))


def _times_s(session: Session, scan: ScanName) -> tuple[Floats, float] | None:
    """Return when the A-scans (n,) of a scan were taken, and how long it lasts."""
    track = scans_of(session, scan)
    if track is None or not len(track):
        return None
    if scan == "hand":
        return track.times_s, float(track.times_s[-1])
    motion = replayed(session, second=scan == "second")
    if motion is None:
        return None
    if len(motion.fired_s) != len(track):  # of passes whose plan is out of date: evenly
        return np.arange(len(track), dtype=np.float64), float(len(track))
    return motion.fired_s, float(motion.times_s[-1])


def ascan_plot(
    session: Session, number: int | None, live: AScan | None = None, scan: ScanName = "first"
) -> AScanPlot | None:
    """Return an A-scan for the graph: the live one if given, else that of a pass by its number."""
    probe = probe_model(session.setup.devices.probe)
    excitation = session.setup.devices.probe.excitation
    if live is not None:
        track, number, found = AScanTrack.from_scans([live]), 0, None
        remark = f"Live, {live.time_s:.1f} s after the start."
    else:
        held = scans_of(session, scan)
        if held is None or number is None or not 0 <= number < len(held):
            return None
        track, found = held, detection_of_scan(session, scan)
        remark = f"A-scan {number + 1} of {len(track)}"
    view = preview(track, number, probe, excitation, found)
    plot = AScanPlot(
        number=number,
        time_us=view.time_us,
        rf=_share(view.rf),
        envelope=readonly(view.envelope / max(float(np.abs(view.rf).max(initial=0.0)), 1e-12)),
        compressed=_share(np.interp(view.time_us, view.matched_us, view.matched)),
        behind_front=_behind(view.time_us, view.matched_us, view.behind_front, view.outer_us),
        outer_us=view.outer_us,
        inner_us=view.inner_us,
        remark=remark,
    )
    return plot if found is None else _judged(plot, found, session, scan, probe)


def _judged(
    plot: AScanPlot, found: Detection, session: Session, scan: ScanName, probe: ProbeModel
) -> AScanPlot:
    """Return the plot with what detection says of it."""
    i, flag = plot.number, int(found.flag[plot.number])
    known = plot.outer_us is not None
    fine = known and plot.inner_us is not None
    by_hand = bool(session.boundary_edits.marks(scan, len(found))[i])
    thickness_mm, sigma_mm, speed = _thickness(session, scan, found, i)
    if fine:
        words = f"bone {thickness_mm:.2f} ± {sigma_mm:.2f} mm"
        words += (
            ", set by hand" if by_hand else f", confidence {100 * found.inner_quality[i]:.0f} %"
        )
    else:
        words = FLAGS[flag]
    other = None
    if known and found.alternative_quality[i] >= WORTH_TELLING:
        other = float(found.alternative_us[i])
        words += (
            f". Other echo at {(other - found.outer_us[i]) * speed / 2:.2f} mm "
            f"({100 * found.alternative_quality[i]:.0f} %)"
        )
    early, late = gate_us(probe)
    first, last = bone_gate_us(probe, nominal_bone(found.sound_speed_mm_per_us))
    outer_us = float(found.outer_us[i])
    return replace(
        plot,
        remark=f"{plot.remark}: {words}.",
        outer_sigma_us=2.0 * float(found.outer_sigma_mm[i]) / probe.line.speed_mm_per_us,
        inner_sigma_us=float(found.inner_sigma_us[i]),
        alternative_us=other,
        guess_us=None if fine or not known else float(found.inner_us[i]),
        front_gate_us=(probe.line_delay_us + early, probe.line_delay_us + late),
        bone_gate_us=(outer_us + first, outer_us + last) if known else None,
        end_us=min(probe.line_delay_us + late + last - first, float(plot.time_us[-1])),
        fine=fine,
        by_hand=by_hand,
    )


def _thickness(
    session: Session, scan: ScanName, found: Detection, i: int
) -> tuple[float, float, float]:
    """Return thickness and sigma in mm of one A-scan as the maps have them, and its speed.

    Without a caliper the speed is the published one, or the one in the message; how well it suits
    the place is unknown.
    """
    hand = scan == "hand"
    known, poses = speed_of_maps(session, hand=hand), scan_poses(session, scan)
    if known is None or poses is None or len(poses) != len(found):
        speed, place = found.sound_speed_mm_per_us, np.zeros((1, 3))
        known = uncalibrated()
    else:
        place = boundary_points(found, poses)[0][i : i + 1]
        speed = float(speed_at(known, place)[0][0])
    thickness_mm = float(found.thickness_mm[i] * speed / found.sound_speed_mm_per_us)
    by_echo = found.thickness_sigma_mm[i] * speed / found.sound_speed_mm_per_us
    by_patient, by_place = speed_uncertainty(known, place)
    by_speed = thickness_mm * np.hypot(by_patient, by_place)[0]
    return thickness_mm, float(np.hypot(by_echo, by_speed)), speed


def scan_picture(session: Session, scan: ScanName = "first") -> ScanPicture | None:
    """Return all A-scans of a pass side by side; None before it."""
    track, poses = scans_of(session, scan), scan_poses(session, scan)
    if track is None or poses is None:
        return None
    steps = np.linalg.norm(np.diff(poses.translations, axis=0), axis=1)
    image = _image(track, session.setup.devices.probe)
    return ScanPicture(image, readonly(np.concatenate(([0.0], np.cumsum(steps)))))


@remember(2)  # A-scans never change, and several browsers ask
def _image(track: AScanTrack, probe: ProbeSettings) -> ScanImage:
    return scan_image(track, probe_model(probe), probe.excitation)


@dataclass(frozen=True, slots=True, eq=False)
class ScanMarks:
    """What is drawn over the picture of a pass (n,), before step 9 nothing."""

    outer_us: Floats
    inner_us: Floats
    outer_ok: Bools
    inner_ok: Bools
    flagged: Bools
    by_hand: Bools
    sound_speed_mm_per_us: float


def scan_marks(session: Session, scan: ScanName = "first") -> ScanMarks | None:
    """Return the boundaries of a pass, hand-made ones among them; None before step 9."""
    found = detection_of_scan(session, scan)
    if found is None:
        return None
    return ScanMarks(
        outer_us=found.outer_us,
        inner_us=found.inner_us,
        outer_ok=found.outer_ok,
        inner_ok=found.inner_ok,
        flagged=readonly(np.asarray(found.flag != 0)),
        by_hand=session.boundary_edits.marks(scan, len(found)),
        sound_speed_mm_per_us=found.sound_speed_mm_per_us,
    )


def _share(values: Floats) -> Floats:
    return readonly(values / max(float(np.abs(values).max(initial=0.0)), 1e-12))


def _behind(time_us: Floats, matched_us: Floats, behind: Floats, outer_us: float | None) -> Floats:
    """Return what is left without the front echo, as a share of its largest value in the bone."""
    values = np.interp(time_us, matched_us, behind)
    if outer_us is None:
        return _share(values)
    bone = (time_us > outer_us) & (time_us < outer_us + BONE_US)
    return readonly(np.clip(values / max(float(values[bone].max(initial=0.0)), 1e-12), 0.0, 1.0))
