"""A tracker that was moved and is found again by the base marker: the error, and its prediction.

Each trial is another tracker (seed) with its own fixed error field. The registration is exact, so
that what is measured is what the move alone costs, at a place on the head.
"""

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.calibration.hand_eye.reference_markers import (
    SeenBase,
    mean_base,
    update_registration,
)
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.devices.settings import TrackerPlace, TrackerProfile, TrackerSettings
from rona_core.devices.trackers import FIELD_MM, GEOMETRIES
from rona_core.geometry.pose import Pose
from rona_core.virtual.scene import (
    BASE_MARKER,
    REGION_CENTER,
    TRACKER_DIRECTION,
    TRACKER_DISTANCE_MM,
)
from rona_core.virtual.tracker.tracker import observe, white_numbers

TRIALS, FRAMES = 300, 15
HONEST = 15.0  # per cent that measured and predicted RMS may differ by
PROFILES: tuple[TrackerProfile, ...] = ("polaris", "vega", "white035")
MOVES = {
    "20 mm": TrackerPlace((20.0, 0.0, 0.0)),
    "75 mm and 1.5°": TrackerPlace((60.0, -40.0, 20.0), 1.5),
}


def run(progress: Progress) -> list[Metric]:
    """Return RMS errors over the trials, and how far they are from what was predicted."""
    metrics: list[Metric] = []
    for profile in PROFILES:
        for words, place in MOVES.items():
            progress(f"{profile}, tracker moved by {words}: {TRIALS} trials")
            pairs = np.array([trial(profile, place, seed) for seed in range(TRIALS)])
            measured, predicted = np.sqrt((pairs**2).mean(axis=0))
            name = f"{profile}, moved by {words}"
            metrics.append(Metric(f"error added, {name}", float(measured), "mm", "lower"))
            share = 100.0 * abs(float(measured / predicted) - 1.0)
            metrics.append(Metric(f"off its prediction by, {name}", share, "%", "lower", HONEST))
    return metrics


def trial(profile: TrackerProfile, place: TrackerPlace, seed: int) -> tuple[float, float]:
    """Return the error at the middle of the region and the predicted one, in mm."""
    T_base_tracker, T_base_basemarker = room()
    turn = Pose.from_rotvec((0.0, 0.0, np.deg2rad(place.turn_deg)), np.zeros(3)).rotation
    T_base_tracker_new = Pose(
        turn @ T_base_tracker.rotation, T_base_tracker.translation + np.array(place.shift_mm)
    )
    settings = TrackerSettings(profile=profile)
    then = seen(T_base_tracker.inv() @ T_base_basemarker, settings, seed, 1)
    now = seen(T_base_tracker_new.inv() @ T_base_basemarker, settings, seed, 2)
    carried = update_registration(
        T_base_tracker, np.zeros((6, 6)), then, now, TrackerErrorField(FIELD_MM[profile])
    )
    head = np.array(REGION_CENTER)
    off = carried.T_base_tracker @ (T_base_tracker_new.inv() @ head) - head
    return float(np.linalg.norm(off)), float(carried.added_sigma_mm(head[None])[0])


def seen(
    T_tracker_basemarker: Pose, settings: TrackerSettings, seed: int, ordinal: int
) -> SeenBase:
    """Return the mean of what the tracker measures of the base marker over some frames."""
    geometry = GEOMETRIES["basemarker"]
    white = white_numbers(seed, "tracker", ordinal, np.arange(FRAMES))["basemarker"]
    reports = observe(geometry, T_tracker_basemarker.repeated(FRAMES), white, settings, seed)
    return mean_base(reports.Ts_tracker_marker.select(reports.seen))


def room() -> tuple[Pose, Pose]:
    """Return tracker and base marker in ``base``, as the virtual room has them by plan."""
    direction = np.array(TRACKER_DIRECTION) / np.linalg.norm(TRACKER_DIRECTION)
    tracker = np.array(REGION_CENTER) + TRACKER_DISTANCE_MM * direction
    level = np.cross(np.array((0.0, 0.0, 1.0)), direction)
    T_base_tracker = Pose(axes(-direction, level), tracker)
    sight = tracker - np.array(BASE_MARKER)
    T_base_basemarker = Pose(axes(sight, np.array((0.0, 0.0, 1.0))), np.array(BASE_MARKER))
    return T_base_tracker, T_base_basemarker


def axes(z: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return axes (3, 3) as columns: z along the one direction, x near the other direction."""
    z = z / np.linalg.norm(z)
    x = towards - (towards @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
