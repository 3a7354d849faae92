"""Landmarks as the virtual robot knows them: its tip was led into each by hand, once."""

from collections.abc import Iterator

import numpy as np

from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.noise import rng
from rona_core.virtual.pointer_motion import cross
from rona_core.virtual.scene import VirtualScene

SEAT_SD_MM = 0.04  # per axis: how the tip sits in a divot
LEANS_DEG = (0.0, 20.0, 40.0)  # of the tool from upright, that the operator tries
TURNS = 12  # about its axis, and of the lean
FIRST_KEY = 1000  # of the motions by hand; others count from 0
LEAST = 3


def teach_landmarks(scene: VirtualScene, model: RobotModel) -> tuple[tuple[str, ...], Floats]:
    """Return names and joint angles (n, 6) at which the true tip sits in the landmarks.

    Raises:
        DeviceError: fewer than three can be reached.
    """
    names: list[str] = []
    postures: list[Floats] = []
    before = model.home_rad  # the arm is led from one to the next
    for number, (name, place) in enumerate(scene.landmarks_base.items()):
        q_rad = _posture(scene, model, place, before, FIRST_KEY + number)
        if q_rad is not None:
            names.append(name)
            postures.append(q_rad)
            before = q_rad
    if len(names) < LEAST:
        raise DeviceError(
            f"the robot reaches {len(names)} landmarks from where its base stands, {LEAST} are the "
            "least: move the base, or scan without verification (override)"
        )
    return tuple(names), np.array(postures)


def _posture(
    scene: VirtualScene, model: RobotModel, place: Vector3, before: Floats, key: int
) -> Floats | None:
    """Return the posture (6,) that the controller keeps of a place, None if it is not reached."""
    seat = rng(scene.seed, "landmark seat", 0, key).normal(0.0, SEAT_SD_MM, 3)
    for rotation in _orientations(np.array(model.work_area.facing_base)):
        tip = Pose(rotation, place)
        q_rad = _reached(model, tip, before)
        if q_rad is None:
            continue
        nominal = (model.forward(q_rad[None]) @ model.T_flange_tip)[0]
        true = scene.Ts_base_tip_true(Poses.stack([nominal]), q_rad[None], 0, np.array([key]))
        off = true.translations[0] - (place + seat)
        return _reached(model, Pose(rotation, place - off), q_rad)
    return None


def _orientations(facing_base: Vector3) -> Iterator[Floats]:
    """Yield rotations (3, 3) of a tip that points down, the most upright first.

    Among these the first has its marker plate towards the tracker, as in the registration.
    """
    turns = 2.0 * np.pi * np.arange(TURNS) / TURNS
    down = np.array((0.0, 0.0, -1.0))
    level = -facing_base * (1.0, 1.0, 0.0)
    x_base = level / np.linalg.norm(level)
    upright = np.column_stack((x_base, cross(down, x_base), down))
    for lean in np.deg2rad(LEANS_DEG):
        for around in turns if lean else turns[:1]:
            leaned = Pose.from_rotvec((lean * np.cos(around), lean * np.sin(around), 0.0)).rotation
            for turn in turns:
                yield leaned @ upright @ Pose.from_rotvec((0.0, 0.0, turn)).rotation


def _reached(model: RobotModel, tip: Pose, before: Floats) -> Floats | None:
    """Return the posture (6,) nearest to another that holds the tip so, None if there is none."""
    found = model.inverse(Poses.stack([tip @ model.T_flange_tip.inv()]))
    qs = [q for q, valid in zip(found.qs_rad[0], found.valid[0], strict=True) if valid]
    inside = [q for q in qs if ((q > model.lower_rad) & (q < model.upper_rad)).all()]
    return min(inside, key=lambda q: float(np.linalg.norm(q - before))) if inside else None
