"""The tip of the true spindle in a fixed seat, about which the virtual arm turns and yields.

A pointed pin as long as the burrs is in the chuck. The seat holds its point where it is, whatever
the robot believes: the encoders tell what the arm gave way by.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.arm import wrapped
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.true_tool_poses import error_keys

PLACED_MM = 0.7  # rms per axis: how well the seat is put where the robot holds the tip first
PLAY_MM = 0.03  # rms per axis: of the pin's point in its seat, anew with every error key
CHUCK_MM = 0.05  # per axis: how the pin sits in the chuck, as a burr does


@dataclass(frozen=True, slots=True)
class Seated:
    """In which capture the tip is in its seat, and from when until when."""

    ordinal: int
    start_s: float
    end_s: float


def seated_postures(
    scene: VirtualScene, model: RobotModel, times_s: Floats, qs_rad: Floats, seated: Seated
) -> Floats:
    """Return the joint angles (n, 6) that an arm really has along a motion (n, 6) at times (n,).

    While it is seated the true point stays in the seat; before and after, the arm comes from the
    commanded motion and goes back to it.

    Raises:
        DeviceError: the tip is never in the seat, or the arm cannot yield that far.
    """
    inside = (times_s >= seated.start_s) & (times_s <= seated.end_s)
    if not inside.any():
        raise DeviceError("the tip is never in its seat during this motion")
    commanded = model.forward(qs_rad) @ model.T_flange_tip
    keys, ordinal = error_keys(times_s[inside]), seated.ordinal
    true = scene.Ts_base_tip_true(commanded.select(inside), qs_rad[inside], ordinal, keys)
    pin_tip = scene.world.spindle_off_tip + _normal(scene, "burr pin", ordinal, 0, CHUCK_MM)
    points = true @ pin_tip
    seat = commanded.translations[inside][0] + _normal(
        scene, "burr seat place", ordinal, 0, PLACED_MM
    )
    buckets, of_row = np.unique(keys, return_inverse=True)
    play = np.array([_normal(scene, "burr seat play", ordinal, int(k), PLAY_MM) for k in buckets])
    edges = np.concatenate((times_s[:1] - 1e-9, times_s[inside], times_s[-1:] + 1e-9))
    yielded = np.pad(seat + play[of_row] - points, ((1, 1), (0, 0)))
    shifts = np.column_stack([np.interp(times_s, edges, axis) for axis in yielded.T])
    return _nearest(model, Poses(commanded.rotations, commanded.translations + shifts), qs_rad)


def _nearest(model: RobotModel, Ts_base_tip: Poses, qs_rad: Floats) -> Floats:
    """Return the joint angles (n, 6) nearest to others that hold the tip so."""
    found = model.inverse(Ts_base_tip @ model.T_flange_tip.inv())
    steps = wrapped(found.qs_rad - qs_rad[:, None])
    sizes = np.where(found.valid, np.abs(steps).max(axis=2), np.inf)
    nearest = sizes.argmin(axis=1)
    rows = np.arange(len(qs_rad))
    if not np.isfinite(sizes[rows, nearest]).all():
        raise DeviceError("the arm cannot yield to the seat: choose another place for it")
    return qs_rad + steps[rows, nearest]


def _normal(scene: VirtualScene, what: str, ordinal: int, key: int, sd_mm: float) -> Floats:
    return rng(scene.seed, what, ordinal, key).normal(0.0, sd_mm, 3)
