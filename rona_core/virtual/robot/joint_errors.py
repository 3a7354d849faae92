"""Joint and link errors of the virtual robot: they depend on its posture, not on its place alone.

Every link is a little longer, shifted and twisted against what its maker states, which a joint off
its zero is a part of, and sags under what hangs on it. Small errors of all six links add up at the
tip to first order (Mooring 1991). What is new with every motion is in ``accuracy_error``.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.noise import rng

LINK_MM, LINK_RAD = 0.15, 1.5e-4  # RMS of a link's shift and twist, per axis, before scaling
SAG_RAD = 2.0e-4  # RMS of a link's turn per metre of arm that hangs on it
BOX_MM = (400.0, 400.0, 300.0)  # around the work area, over which the error has its RMS
TILT_RAD = 0.3  # of the tool from straight down, RMS per axis
SAMPLES = 400
AT_ONCE = 1024  # postures whose links are held at a time


class JointErrors:
    """Twists of the link frames of one robot."""

    def __init__(self, seed: int, model: RobotModel, rms_mm: float) -> None:
        """Draw the errors of a robot, 3D RMS ``rms_mm`` at the tip over its work area.

        Raises:
            RonaError: the robot reaches no place of its work area.
        """
        self._model = model
        random = rng(seed, "joint errors", 0, 0)
        self._shifts_mm = random.normal(0.0, LINK_MM, (6, 3))  # in the link's own frame
        self._turns_rad = random.normal(0.0, LINK_RAD, (6, 3))
        self._sag_rad_per_mm = SAG_RAD / 1000.0 * np.abs(random.normal(0.0, 1.0, 6))
        qs = _postures(model, rng(seed, "joint errors", 0, 1))
        tips = model.forward(qs) @ model.T_flange_tip
        shifts, _ = self.deviations(qs, tips.translations)
        scale = rms_mm / float(np.sqrt((shifts**2).sum(axis=1).mean()))
        self._shifts_mm *= scale
        self._turns_rad *= scale
        self._sag_rad_per_mm *= scale

    def deviations(self, qs_rad: Floats, points_base: Floats) -> tuple[Floats, Floats]:
        """Return by how much points carried by the tool are off, and the tool is turned.

        Args:
            qs_rad: Joint angles (n, 6).
            points_base: One point for each (n, 3), in ``base``.

        Returns:
            Shifts (n, 3) in mm and rotation vectors (n, 3) in radians, in ``base``.
        """
        found = np.zeros((2, len(qs_rad), 3))
        for start in range(0, len(qs_rad), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            found[:, some] = self._deviations(qs_rad[some], points_base[some])
        return found[0], found[1]

    def _deviations(self, qs_rad: Floats, points_base: Floats) -> tuple[Floats, Floats]:
        rotations, origins = self._model.arm.link_frames(qs_rad)
        rotations, origins = rotations[:, 1:], origins[:, 1:]
        turns = np.einsum("nkij,kj->nki", rotations, self._turns_rad)
        shifts = np.einsum("nkij,kj->nki", rotations, self._shifts_mm)
        arms = points_base[:, None] - origins
        # what hangs on a link turns it about the horizontal across the arm, downwards
        sag = np.stack((-arms[..., 1], arms[..., 0], np.zeros(arms.shape[:2])), axis=-1)
        turns = turns + self._sag_rad_per_mm[:, None] * sag
        return (shifts + np.cross(turns, arms)).sum(axis=1), turns.sum(axis=1)


def _postures(model: RobotModel, random: np.random.Generator) -> Floats:
    """Return postures (n, 6) with the tool about straight down in the work area."""
    center = np.array(model.work_area.region_base)
    places = center + random.uniform(-0.5, 0.5, (SAMPLES, 3)) * BOX_MM
    rolls = random.uniform(-np.pi, np.pi, SAMPLES)
    leans = random.normal(0.0, TILT_RAD, (SAMPLES, 2))
    down = np.column_stack((leans, np.zeros(SAMPLES)))
    turn = np.zeros((SAMPLES, 3, 3))
    turn[:, 0, 0], turn[:, 0, 1] = np.cos(rolls), np.sin(rolls)
    turn[:, 1, 0], turn[:, 1, 1] = np.sin(rolls), -np.cos(rolls)
    turn[:, 2, 2] = -1.0
    tips = Poses(Rotation.from_rotvec(down).as_matrix() @ turn, places)
    solved = model.inverse(tips @ model.T_flange_tip.inv())
    reached = solved.valid.any(axis=1)
    if not reached.any():
        raise RonaError(f"the {model.name} reaches no place of its work area")
    first = np.argmax(solved.valid, axis=1)
    return solved.qs_rad[reached, first[reached]]
