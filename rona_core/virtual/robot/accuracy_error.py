"""Accuracy error of the virtual robot: systematic part, repeatability and tool tilt.

Three parts: a systematic one (what calibration of the arm would remove), a small new deviation
with every motion (repeatability), and a tilt of the tool. The systematic part is a smooth field
over the workspace, or that of joints and links (``joint_errors``).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, as_points, readonly
from rona_core.geometry.pose import Poses
from rona_core.virtual.robot.joint_errors import JointErrors

SYSTEMATIC_RMS_MM = 0.35  # 3D, over the workspace
REPEATABILITY_RMS_MM = 0.03  # 3D
TILT_RMS_DEG = 0.02
WORKSPACE_CENTER = (600.0, 0.0, 350.0)  # in base
WORKSPACE_SIZE = (500.0, 500.0, 400.0)
LENGTH_SCALE_MM = 400.0  # over which the systematic field changes
N_WAVES = 32  # each with its own direction, length and phase
SALT_FIELD, SALT_MOTION = 0x6669656C, 0x6D6F7665  # keep the two kinds of noise apart


class RobotError:
    """Deviation of the true tip pose from the nominal one; a pure function of its arguments."""

    def __init__(
        self,
        seed: int,
        enabled: bool = True,
        rms_mm: float = SYSTEMATIC_RMS_MM,
        joints: JointErrors | None = None,
    ) -> None:
        """Draw the error of a robot.

        Args:
            seed: Of the session.
            enabled: False: the robot is exact.
            rms_mm: 3D RMS of the field over the workspace.
            joints: What takes the place of the field.
        """
        self.enabled, self._joints = enabled, joints
        self._seed = seed
        rng = np.random.default_rng((SALT_FIELD, *_words(seed)))
        self._waves = rng.normal(0.0, 1.0 / LENGTH_SCALE_MM, (N_WAVES, 3))
        self._phases_rad = rng.uniform(0.0, 2.0 * np.pi, N_WAVES)
        self._sizes_mm = rng.normal(0.0, 1.0, (N_WAVES, 3))
        axes = [np.linspace(-0.5, 0.5, 15) * size for size in WORKSPACE_SIZE]
        box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        rms = np.sqrt((self._field(box + np.array(WORKSPACE_CENTER)) ** 2).sum(axis=1).mean())
        self._sizes_mm *= rms_mm / rms

    def systematic_mm(self, points_base: ArrayLike, qs_rad: Floats | None = None) -> Floats:
        """Return the part (n, 3) that is the same every time, at points (n, 3) in ``base``.

        Args:
            points_base: Where the encoders say that points of the tool are.
            qs_rad: Joint angles (n, 6) that the tool is there with. A robot that errs by its
                joints needs them.
        """
        points = as_points(points_base, name="points_base")
        if not self.enabled:
            return readonly(np.zeros_like(points))
        return readonly(self._systematic(points, qs_rad)[0])

    def Ts_base_tip_true(  # noqa: N802 (frame grammar)
        self, Ts_base_tip_nominal: Poses, qs_rad: Floats | None, ordinal: int, keys: Ints
    ) -> Poses:
        """Return where the tip really is while the encoders say ``Ts_base_tip_nominal`` (n,).

        Args:
            Ts_base_tip_nominal: Poses from the encoders.
            qs_rad: Joint angles (n, 6) of the encoders, as for ``systematic_mm``.
            ordinal: Number of the capture.
            keys: Numbers (n,) of the commanded motion, or of the slice of time, in the capture.
        """
        if not self.enabled:
            return Ts_base_tip_nominal
        motions, of_row = np.unique(keys, return_inverse=True)
        new = [_repeatability(self._seed, ordinal, key) for key in motions.tolist()]
        shifts, tilts_rad = np.split(np.array(new), 2, axis=1)
        positions = Ts_base_tip_nominal.translations
        rotations = Rotation.from_rotvec(tilts_rad).as_matrix()[of_row]
        systematic_mm, turns_rad = self._systematic(positions, qs_rad)
        if turns_rad is not None:
            rotations = rotations @ Rotation.from_rotvec(turns_rad).as_matrix()
        return Poses.unchecked(
            rotations @ Ts_base_tip_nominal.rotations,
            positions + systematic_mm + shifts[of_row],
        )

    def _systematic(self, points: Floats, qs_rad: Floats | None) -> tuple[Floats, Floats | None]:
        """Return shifts (n, 3) and, of a robot that errs by its joints, rotation vectors (n, 3)."""
        if self._joints is None:
            return self._field(points), None
        if qs_rad is None:
            raise InvalidInputError("a robot that errs by its joints needs their angles")
        return self._joints.deviations(qs_rad, points)

    def of_motion_mm(self, ordinal: int, key: int) -> Floats:
        """Return the part of the shift (3,) that is new with every motion; see above."""
        return _repeatability(self._seed, ordinal, key)[:3] if self.enabled else np.zeros(3)

    def _field(self, points: Floats) -> Floats:
        return np.cos(points @ self._waves.T + self._phases_rad) @ self._sizes_mm


@lru_cache(maxsize=1024)  # tool, probe and sensor ask for the same motions
def _repeatability(seed: int, ordinal: int, key: int) -> Floats:
    """Return shift in mm and rotation vector in radians (6,) of one motion."""
    words = (SALT_MOTION, *_words(seed), *_words(ordinal), *_words(key))
    values = np.random.default_rng(words).normal(0.0, 1.0 / np.sqrt(3.0), 6)
    return readonly(values * np.repeat((REPEATABILITY_RMS_MM, np.deg2rad(TILT_RMS_DEG)), 3))


def _words(number: int) -> tuple[int, int]:
    """Return any integer as two words without sign, as seeds have to be."""
    return abs(int(number)), int(number < 0)
