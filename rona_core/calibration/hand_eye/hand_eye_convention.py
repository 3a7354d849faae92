"""Convention of the poses of a hand-eye calibration: which change makes robot and sensor agree.

Each change that people make by mistake is undone in turn and the equation is solved in closed form,
with a free scale of the sensor's lengths. Rotations of a rigid pair agree whatever the scale, so
they decide first; of what agrees in rotation the translations decide. A wrong unit, or a board
whose squares were measured wrong, shows in the scale.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rona_core.calibration.hand_eye.hand_eye import first_guess
from rona_core.calibration.pivot.pose_convention import CHANGES
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import rotation_vectors

LEAST_DEG, LEAST_MM = 0.05, 0.2  # agreement that is as good as any
WORSE = 4.0  # agreement as stated over that after a change, from which the change is named
USUAL_DEG = 3.0  # of poses that belong together
OFF_SCALE = 0.02  # of lengths, beyond what its own error explains
SURE = 5.0  # standard errors
UNITS = {1000.0: "metres", 10.0: "centimetres", 25.4: "inches"}
NEAR_UNIT = 0.03  # relative


@dataclass(frozen=True, slots=True)
class _Agreement:
    """How well robot and sensor agree after a change."""

    turn_deg: float  # median
    shift_mm: float  # median, with the best scale
    scale: float  # of the sensor's lengths
    scale_sigma: float


def require_convention(Ts_base_tip: Poses, Ts_tracker_marker: Poses, *, in_hand: bool) -> None:
    """Refuse poses in another convention by the name of the change that explains them.

    Args:
        Ts_base_tip: Of the robot.
        Ts_tracker_marker: Of the sensor, pair by pair.
        in_hand: Whether the sensor is on the robot.

    Raises:
        InvalidInputError: a change fits clearly better; ``data`` has its key as ``change``.
    """
    stated = _agreement(Ts_base_tip, Ts_tracker_marker, in_hand)
    found = {
        (words, key): _agreement(robot, sensor, in_hand)
        for (words, key), (robot, sensor) in _changed(Ts_base_tip, Ts_tracker_marker).items()
    }
    best_deg = max(LEAST_DEG, min(one.turn_deg for one in (stated, *found.values())))
    alike = {k: one for k, one in found.items() if one.turn_deg <= 2.0 * best_deg}
    if alike and best_deg <= USUAL_DEG:
        (words, key), one = min(alike.items(), key=lambda item: item[1].shift_mm)
        turned = stated.turn_deg > WORSE * max(one.turn_deg, LEAST_DEG)
        if turned or stated.shift_mm > WORSE * max(one.shift_mm, LEAST_MM):
            raise InvalidInputError(
                f"{words} (then they agree to {one.turn_deg:.2g} degrees and {one.shift_mm:.2g} "
                f"mm, as they are to {stated.turn_deg:.2g} degrees and {stated.shift_mm:.2g} mm)",
                change=key,
            )
    if stated.turn_deg > USUAL_DEG and best_deg > USUAL_DEG:
        raise InvalidInputError(
            f"the turns of robot and sensor differ by {stated.turn_deg:.0f} degrees (median), "
            "whichever way they are read: check that row by row the poses belong together, and "
            "that the marker and the sensor did not move",
            change="pairs",
        )
    off = abs(stated.scale - 1.0)
    if off > max(OFF_SCALE, SURE * stated.scale_sigma):
        unit = next((w for u, w in UNITS.items() if abs(stated.scale / u - 1.0) < NEAR_UNIT), None)
        inverse = next((w for u, w in UNITS.items() if abs(stated.scale * u - 1.0) < 0.03), None)
        if unit is not None:
            cause = f"the sensor's positions are in {unit}: say --unit for its file, or convert it"
        elif inverse is not None:
            cause = (
                f"the robot's positions are in {inverse}: say --unit for its file, or convert it"
            )
        else:
            cause = (
                f"the sensor's lengths have to be multiplied by {stated.scale:.3g} to fit those "
                "of the robot: measure the squares of the board, or the tag, again"
            )
        raise InvalidInputError(f"wrong units: {cause}", change="unit")


def _changed(robot: Poses, sensor: Poses) -> dict[tuple[str, str], tuple[Poses, Poses]]:
    """Return the poses after each change, under its words and its key."""
    inverted: Callable[[Poses], Poses] = CHANGES["inverted"].undo
    one = (
        "the poses fit the other set-up (sensor on the robot, or beside it), or those of the robot "
        "or of the sensor are inverted: give the other --setup, or the inverse of one file "
        "(--inverse robot, --inverse sensor)"
    )
    found = {(one, "inverted"): (inverted(robot), sensor)}
    names = ("transposed", "real part first", "real part last")
    for key in (name for name in names if name in CHANGES):
        change = CHANGES[key]
        for whose, pair in (
            ("robot", (change.undo(robot), sensor)),
            ("sensor", (robot, change.undo(sensor))),
        ):
            words = f"of the {whose}: {change.words}. {change.remedy[0].upper()}{change.remedy[1:]}"
            found[words, f"{key}, {whose}"] = pair
    return found


def _agreement(robot: Poses, sensor: Poses, in_hand: bool) -> _Agreement:
    Ts_b_a = robot.inv() if in_hand else robot
    sensor_pose, marker_pose = first_guess(Ts_b_a, sensor)
    expected = sensor_pose.rotation.T @ Ts_b_a.rotations @ marker_pose.rotation.T
    apart = rotation_vectors(np.swapaxes(expected, 1, 2) @ sensor.rotations)
    turns_deg = np.rad2deg(np.linalg.norm(apart, axis=1))
    shift, scale, sigma = _with_scale(Ts_b_a, sensor, sensor_pose)
    return _Agreement(float(np.median(turns_deg)), shift, scale, sigma)


def _with_scale(Ts_b_a: Poses, sensor: Poses, sensor_pose: Pose) -> tuple[float, float, float]:
    """Return the median misfit in mm, the scale of the sensor's lengths, and its deviation.

    Place of the robot = origin + R (M x + scale t), linear in x, scale and origin; reweighted so
    that gross errors do not count (Huber 2009).
    """
    n = len(sensor)
    design = np.zeros((n, 3, 7))
    design[:, :, :3] = sensor.rotations
    design[:, :, 3] = sensor.translations
    design[:, :, 4:] = np.eye(3)
    wanted = Ts_b_a.translations @ sensor_pose.rotation
    weights = np.ones(n)
    misses, x = np.zeros(n), np.zeros(7)
    size = np.maximum(np.abs(design).max(axis=(0, 1)), 1e-12)
    for _ in range(8):
        whole = (design / size * weights[:, None, None]).reshape(-1, 7)
        x = np.linalg.lstsq(whole, (wanted * weights[:, None]).ravel())[0] / size
        misses = np.linalg.norm(design @ x - wanted, axis=1)
        weights = np.sqrt(1.0 / np.maximum(1.0, misses / max(float(np.median(misses)), 1e-9)))
    whole = (design * weights[:, None, None]).reshape(-1, 7)
    spread = np.linalg.pinv(whole.T @ whole)[3, 3]
    scatter = (weights * misses) ** 2
    sigma = float(np.sqrt(spread * scatter.sum() / max(3 * n - 7, 1)))
    return float(np.median(misses)), float(x[3]), sigma
