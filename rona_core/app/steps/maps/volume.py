"""The echo volume of the robot's scan, computed when it is asked for; nothing of it is stored."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.steps.acoustics.derivation import DETECTION, ROBOT_PROBE
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.scan.derivation import PLACES, POSES, SCAN, joined_poses, joined_scans
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import StaleResultError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.volume.echo_volume import EchoVolume, IsoSurface, iso_surface
from rona_core.mapping.volume.inner_ridge import RidgeAgreement, ridge_agreement
from rona_core.mapping.volume.reconstruction import ScanLines, VolumeSettings, reconstruct_volume
from rona_core.session.document import Derived, Session
from rona_core.session.memo import Memo, remember
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.echo_profiles import EchoProfiles, echo_profiles
from rona_core.ultrasound.detection.manual_corrections import ScanName, corrected
from rona_core.ultrasound.probe.probe_model import ProbeModel, ProbeSurvey

_LINES: Memo[ScanLines] = Memo(2)  # the A-scans stay as they are while a grid is chosen


def echo_volume(session: Session, settings: VolumeSettings | None = None) -> EchoVolume:
    """Return the echoes of all passes on the columns of the robot's maps.

    The front echo of an A-scan lies where the maps have its outer boundary; behind it time is
    counted at the speed that they were made with.

    Args:
        session: With its scan and its maps.
        settings: Of the grid; None: the usual ones.

    Raises:
        StepBlockedError: there is no scan, or nothing was mapped.
        StaleResultError: the maps or what was detected are out of date.
        InvalidInputError: the grid would have too many voxels.
    """
    lines, maps = scan_lines(session), required(MAPS, session)
    return _volume(lines, maps, required(ROBOT_PROBE, session), settings or VolumeSettings())


def volume_agreement(session: Session) -> RidgeAgreement | None:
    """Return how the inner ridge of the usual volume lies beside the inner map; errors as above."""
    return _agreement(echo_volume(session), required(MAPS, session))


def volume_surface(session: Session, level_db: float, gain_db_per_mm: float = 0.0) -> IsoSurface:
    """Return the iso-surface of the usual volume; arguments as of ``iso_surface``."""
    return _surface(echo_volume(session), level_db, gain_db_per_mm)


def volume_file(
    session: Session, *, depth_step_mm: float | None = None, fill_radius_mm: float | None = None
) -> bytes:
    """Return the echo volume as a NRRD file; None: as usual.

    Raises:
        InvalidInputError: height of a voxel or radius of filling out of range.
        StepBlockedError: see ``echo_volume``, as for all others.
    """
    from rona_core.mapping.volume.echo_volume import volume_nrrd  # pynrrd is slow to import

    given = {"depth_step_mm": depth_step_mm, "fill_radius_mm": fill_radius_mm}
    wanted = VolumeSettings(**{name: mm for name, mm in given.items() if mm is not None})
    lines = scan_lines(session)
    notes = {
        "compounding": "mean",
        "interpolation": "linear",
        "fill radius (mm)": f"{wanted.fill_radius_mm:g}",
        "sound speed in bone (mm/us)": f"{float(np.median(lines.speeds_mm_per_us)):.4f}",
        "a-scans": str(len(lines.speeds_mm_per_us)),
        "probe": session.setup.devices.probe.name,
    }
    return volume_nrrd(echo_volume(session, wanted), notes)


@remember(2)
def _volume(
    lines: ScanLines, maps: Maps, probe: ProbeModel, settings: VolumeSettings
) -> EchoVolume:
    return reconstruct_volume(lines, maps.outer, probe, settings)


@remember(2)
def _agreement(volume: EchoVolume, maps: Maps) -> RidgeAgreement | None:
    return ridge_agreement(volume, maps)


@remember(4)  # several browsers look at it
def _surface(volume: EchoVolume, level_db: float, gain_db_per_mm: float) -> IsoSurface:
    return iso_surface(volume, level_db, gain_db_per_mm)


def scan_lines(session: Session) -> ScanLines:
    """Return the A-scans of all passes whose outer boundary went into the maps, as lines.

    Raises:
        StepBlockedError: there is no scan, or nothing was mapped.
        StaleResultError: the maps or what was detected are out of date.
    """
    required(SCAN, session)
    maps = required(MAPS, session)
    required(DETECTION, session)
    again = ("second_detection",) if usable_second(session) else ()
    for name in ("detection", *again, "maps"):
        reason = stale_reason(name, session)
        if reason is not None:
            raise StaleResultError(f"the echo volume is of the maps, and they are stale: {reason}")
    passes = _passes(session)
    if sum(len(one.found) for one in passes) != len(maps.outer_used):
        raise StaleResultError(
            f"the maps are of {len(maps.outer_used)} A-scans, and there are "
            f"{sum(len(one.found) for one in passes)}: map the boundaries again"
        )
    parts = tuple(part for one in passes for part in (one.scans, one.detected, one.poses))
    probe, excitation = required(ROBOT_PROBE, session), session.setup.devices.probe.excitation

    def build() -> ScanLines:
        return _lines(passes, maps, probe, excitation)

    return _LINES.get((maps, session.boundary_edits, *parts), build, (probe, excitation))


@dataclass(frozen=True, slots=True, eq=False)
class _Pass:
    """A-scans (n) of a pass, what was detected in them, and where the probe was."""

    scans: AScanTrack
    detected: Detection
    found: Detection  # the same with what was set by hand in its place
    poses: Poses


def _passes(session: Session) -> tuple[_Pass, ...]:
    """Return the passes that went into the maps; all further ones count as one."""
    results, captures = session.results, session.captures
    found: list[_Pass] = []

    def add(
        name: ScanName, scans: AScanTrack, derived: Derived[Detection] | None, poses: Poses
    ) -> None:
        if derived is not None:
            edits, probe = session.boundary_edits, required(ROBOT_PROBE, session)
            edited = corrected(derived.value, edits, name, probe)
            found.append(_Pass(scans, derived.value, edited, poses))

    if captures.scan is not None:
        add("first", captures.scan.scans, results.detection, required(POSES, session))
    if passes := usable_second(session):
        scans, poses = joined_scans(passes), joined_poses(required(PLACES, session), passes)
        add("second", scans, results.second_detection, poses)
    return tuple(found)


def _lines(
    passes: tuple[_Pass, ...], maps: Maps, probe: ProbeModel, excitation: Excitation
) -> ScanLines:
    """Return the lines of all passes, at the places and speeds of the maps."""
    n, kept = len(passes[0].found), maps.outer_used.copy()
    kept[n:] = np.concatenate([np.zeros(0, np.bool_), *(p.found.outer_ok for p in passes[1:])])
    profiles = [_profiles(one, probe, excitation) for one in passes]
    levels = np.concatenate([part.level for part in profiles])[kept]
    axes = np.concatenate([one.poses.rotations[:, :, 2] for one in passes])
    lags_us = np.concatenate([one.found.inner_us - one.found.outer_us for one in passes])
    speeds = _speeds(maps, lags_us, passes[0].found.sound_speed_mm_per_us)
    joined = EchoProfiles(profiles[0].first_us, profiles[0].step_us, levels)
    return ScanLines(maps.outer_points_base[kept], axes[kept], speeds[kept], joined)


def _profiles(one: _Pass, probe: ProbeModel, excitation: Excitation) -> EchoProfiles:
    survey = ProbeSurvey(one.scans, probe, excitation, known_standoff_mm=one.found.standoff_mm)
    return echo_profiles(survey)


def _speeds(maps: Maps, lags_us: Floats, usual: float) -> Floats:
    """Return the speed (n,) that turned the time between the boundaries into a thickness.

    Where an A-scan has no time between them it is that of most.
    """
    apart = np.linalg.norm(maps.inner_points_base - maps.outer_points_base, axis=1)
    timed: Bools = np.asarray((lags_us > 0.0) & (apart > 0.0))
    speeds = np.divide(2.0 * apart, lags_us, out=np.full(len(lags_us), usual), where=timed)
    return np.where(timed, speeds, float(np.median(speeds[timed])) if timed.any() else usual)
