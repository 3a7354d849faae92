"""Hand-eye calibrations from files: read, paired and calibrated, for terminal, Python and REST."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rona_core.calibration.hand_eye.recorded_poses import (
    HandEyeCalibration,
    SensorNoise,
    Setup,
    calibrate_hand_eye,
)
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.pose_matrices import require_millimetres
from rona_core.devices.files.poses.recorded_poses import (
    PLAIN,
    RecordedPoses,
    chosen_tool,
    read_poses,
)
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.recording import Recording
from rona_core.errors import InvalidInputError, RonaError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose, Poses

Files = Sequence[NamedFile | Path | str]
Inverse = Literal["robot", "sensor", "both"]
APART = 0.5  # of the time between two frames, by which a pair may be apart


@dataclass(frozen=True, slots=True)
class HandEyeOptions:
    """What a person says of a hand-eye calibration."""

    setup: Setup = "eye-to-hand"
    noise: SensorNoise = "tracker"
    inverse: Inverse | None = None  # whose poses are the inverse of what is expected
    robot: str | None = None  # name of the robot's poses, where a file has several
    sensor: str | None = None  # likewise


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeReport:
    """What was read, and what follows from it."""

    calibration: HandEyeCalibration
    rows: Ints  # (n,) of each pair in the robot's recording
    robot: str  # file and tool
    sensor: str
    notes: tuple[str, ...]  # what was changed on reading, and how pairs were found

    def figures(self) -> dict[str, Any]:
        """Return the figures as plain values: mm and degrees, matrices row by row."""
        found = self.calibration
        used = found.used
        sigmas = np.sqrt(np.diag(found.covariance))
        where = ("base", "tip") if found.setup == "eye-to-hand" else ("tip", "base")
        following = found.next_pose
        return {
            "setup": found.setup,
            "noise": found.noise,
            "sensor_in": where[0],
            "sensor": _plain(found.sensor),
            "sensor_sigma_mm": _size(sigmas[3:6]),
            "sensor_sigma_deg": float(np.rad2deg(_size(sigmas[:3]))),
            "marker_in": where[1],
            "marker": _plain(found.marker),
            "covariance": found.covariance.tolist(),
            "sigma_mm": found.sigma_mm,
            "rms_mm": _rms(found.shifts_mm[used]),
            "rms_deg": _rms(found.turns_deg[used]),
            "left_out_rms_mm": _rms(found.left_out_mm[used]),
            "left_out_rms_deg": _rms(found.left_out_deg[used]),
            "pose_sigma_mm": found.shift_sigma_mm.tolist(),
            "pose_sigma_deg": np.rad2deg(found.turn_sigma_rad).tolist(),
            "n_used": int(used.sum()),
            "n_rejected": int((~used).sum()),
            "worst": [
                {
                    "pose": int(self.rows[i]),
                    "off_mm": float(found.left_out_mm[i]),
                    "off_deg": float(found.left_out_deg[i]),
                    "used": bool(used[i]),
                }
                for i in found.worst()
            ],
            "next_pose": {
                "turn_deg": following.angle_deg,
                "axis_tip": following.axis_tip.tolist(),
                "T_base_tip": _plain(following.T_base_tip),
                "sigma_mm": following.sigma_mm,
            },
            "verdict": found.verdict,
            "reasons": list(found.reasons),
            "notes": list(self.notes),
        }


def report_hand_eye(
    robot: Files,
    sensor: Files | None = None,
    options: HandEyeOptions = HandEyeOptions(),
    *,
    layouts: tuple[PoseLayout, PoseLayout] = (PLAIN, PLAIN),
) -> HandEyeReport:
    """Read poses of robot and sensor, pair them, and calibrate.

    Args:
        robot: Files with the poses of the robot's tool in its base, as `read_poses` takes them.
        sensor: Files with the poses of the marker (or board) in the sensor; None: they are in the
            files of the robot, the second tool there.
        options: What the poses are of.
        layouts: What the files of robot and sensor do not say.

    Raises:
        InvalidInputError: the files hold no poses or no pairs, or are in another convention.
        DegenerateGeometryError: the motion leaves something open, or too few poses agree.
    """
    first = read_poses(robot, layouts[0])
    second = first if sensor is None else read_poses(sensor, layouts[1])
    names = _tools(first, second, options)
    for found, name in zip((first, second), names, strict=True):
        poses = found.recording.tool(name).Ts_tracker_marker
        require_millimetres(poses.translations, f"{found.name}, {name}")
    (moved, seen), rows, pairing = _paired(first, second, names)
    moved = moved.inv() if options.inverse in ("robot", "both") else moved
    seen = seen.inv() if options.inverse in ("sensor", "both") else seen
    files = " and ".join(dict.fromkeys((first.name, second.name)))
    try:
        calibration = calibrate_hand_eye(moved, seen, setup=options.setup, noise=options.noise)
    except RonaError as error:
        raise type(error)(f"{files}: {error}", **error.data) from error
    notes = tuple(dict.fromkeys((*first.notes, *second.notes, *pairing)))
    labels = [f"{f.name}, {name}" for f, name in zip((first, second), names, strict=True)]
    return HandEyeReport(calibration, rows, labels[0], labels[1], notes)


def _tools(first: RecordedPoses, second: RecordedPoses, options: HandEyeOptions) -> tuple[str, str]:
    """Return whose poses are those of the robot and of the sensor."""
    tools = [column.tool for column in first.recording.tools]
    if first is second and len(tools) == 1:
        raise InvalidInputError(
            f"{first.name} has poses of {tools[0]} alone: name a second file, with the poses of "
            "the sensor"
        )
    if first is second and len(tools) == 2 and options.robot is options.sensor is None:
        return tools[0], tools[1]
    option = "--robot NAME and --sensor NAME"
    try:
        return (
            chosen_tool(first.recording, options.robot, None, first.name),
            chosen_tool(second.recording, options.sensor, None, second.name),
        )
    except InvalidInputError as error:
        raise InvalidInputError(str(error).replace("--tool", option)) from error


def _paired(
    first: RecordedPoses, second: RecordedPoses, names: tuple[str, str]
) -> tuple[tuple[Poses, Poses], Ints, tuple[str, ...]]:
    """Return poses that belong together, their rows in the first recording, and a note.

    Raises:
        InvalidInputError: the recordings have different lengths and no common clock.
    """
    a, b = (f.recording.tool(name) for f, name in zip((first, second), names, strict=True))
    both = np.zeros(0, dtype=np.int64)
    if len(a.rows) == len(b.rows):
        both = np.flatnonzero(a.seen() & b.seen())
    seen = [int(column.seen().sum()) for column in (a, b)]
    if len(a.rows) == len(b.rows) and (2 * len(both) >= min(seen) or not first.clocked):
        pair = a.Ts_tracker_marker.select(a.rows[both]), b.Ts_tracker_marker.select(b.rows[both])
        return pair, both, ()
    if not (first.clocked and second.clocked):
        raise InvalidInputError(
            f"{first.name} has {seen[0]} poses and {second.name} {seen[1]}: expected a row of each "
            "for every pair, or times in both by which they are paired"
        )
    ta, tb = _times(first.recording, names[0]), _times(second.recording, names[1])
    near = np.abs(ta[:, None] - tb[None]).argmin(axis=1)
    apart = APART * min(float(np.median(np.diff(t))) for t in (ta, tb))
    rows = np.flatnonzero(np.abs(ta - tb[near]) <= apart)
    rows = rows[np.unique(near[rows], return_index=True)[1]]
    if not len(rows):
        raise InvalidInputError(
            f"{first.name} and {second.name} have no times in common: their clocks differ; write a "
            "row of each for every pair"
        )
    pair = a.Ts_tracker_marker.select(rows), b.Ts_tracker_marker.select(near[rows])
    held = np.flatnonzero(a.seen())[rows]
    return pair, held, (f"{len(rows)} pairs were found by their times.",)


def _times(recording: Recording, name: str) -> Floats:
    return recording.times_s[recording.tool(name).seen()]


def _plain(pose: Pose) -> dict[str, Any]:
    return {
        "matrix": pose.matrix().tolist(),
        "wxyz": pose.wxyz().tolist(),
        "translation_mm": pose.translation.tolist(),
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))


def _size(sigmas: Floats) -> float:
    return float(np.linalg.norm(sigmas))


def both_layouts(layout: PoseLayout, unit: str | None) -> tuple[PoseLayout, PoseLayout]:
    """Return the layouts of robot and sensor; ``unit`` is one for both, or one each: m,mm.

    Raises:
        InvalidInputError: another unit.
    """
    words = (unit or "").split(",")
    if unit is not None and (len(words) > 2 or any(w not in ("mm", "cm", "m") for w in words)):
        raise InvalidInputError(f"--unit is mm, cm or m, or one each such as m,mm; not {unit!r}")
    units: list[Any] = [None, None] if unit is None else [words[0], words[-1]]
    return replace(layout, unit=units[0]), replace(layout, unit=units[1])
