"""Places of the base for sphere patches that cannot be scanned from where it stands."""

from time import process_time

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from rona_core.devices.settings import RobotSettings
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.placement import place_base
from rona_core.robot.base_placement.reachability import (
    BasePlace,
    BaseSearch,
    CoarseScreening,
    base_pose,
    path_from,
)
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan_motion import plan_scan
from tests.scenes.patch_scenes import scene_model, scene_path

HOME = RobotSettings()
PLACES = 143  # of the default grid
SCENES = ("S3", "S0")


def run(progress: Progress) -> list[Metric]:
    """Return whether suggestions verify on the dense path, how far the base moves, and times."""
    model = scene_model()
    search = BaseSearch()
    screen = CoarseScreening(scene_path("S3"), model, search)
    grid_ms = PLACES * cpu_ms(lambda: screen.margin(Pose.identity()))
    metrics = [Metric("S3-90: screening of 143 places, CPU", grid_ms, "ms", "lower", 2000.0)]
    for scene in SCENES:
        progress(f"scene {scene}")
        start = process_time()
        found = place_base(scene_path(scene), model, HOME)
        spent_s = process_time() - start
        label = f"{scene}-90"
        margin = None if found.best is None else found.best.margin
        seeming = np.count_nonzero((found.margins >= 0.0) & ~found.blocked)
        works = float(sum(_verifies(scene, place, model) for place in (found.best, found.smallest)))
        metrics += [
            Metric(
                f"{label}: suggestions that verify when planned again", works, "of 2", "higher", 2
            ),
            Metric(f"{label}: places that seem to work", float(seeming), "", "higher"),
            Metric(f"{label}: largest margin", margin, "", "higher"),
            Metric(f"{label}: whole search, CPU", 1e3 * spent_s, "ms", "lower"),
        ]
        smallest_mm = found.smallest.moved_mm if found.smallest else None
        goal = 0.0 if scene == "S0" else None  # it works from where it stands
        metrics.append(Metric(f"{label}: smallest move", smallest_mm, "mm", "lower", goal))
    return metrics


def _verifies(scene: str, place: BasePlace | None, model: RobotModel) -> bool:
    if place is None:
        return False
    old_in_new = base_pose(place.shift_mm, place.turn_deg).inv()
    return plan_scan(path_from(scene_path(scene), old_in_new), model).may_move
