"""Contact depth of the probe: true bone against the true probe face, robot error included.

The bone does not give way, the delay line does. So the depth is that of the face of the
uncompressed line under the true surface, along the probe's axis, which is the stand-off that the
echoes show, with the other sign.
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.robot.corrected_motion import CorrectedMotion
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.true_tool_poses import error_key

BEFORE_MM = 60.0  # rays start this far before the face
FAR_MM = 1e3  # depth of nothing: a gap


class ContactDepth:
    """Depths along one guided motion, for one capture."""

    def __init__(self, scene: VirtualScene, model: RobotModel, ordinal: int) -> None:
        """Look at this scene."""
        self._scene, self._model, self._ordinal = scene, model, ordinal
        self._course: CorrectedMotion | None = None

    def depths_mm(self, course: CorrectedMotion | None, times_s: Floats) -> Floats:
        """Return how deep (n,) the face is pressed in at times of the capture; negative: a gap."""
        if course is None:
            return np.full(len(times_s), -FAR_MM)
        if course is not self._course:
            self._look_along(course)
        reached, travels = course.looks(times_s)
        gaps = np.interp(reached, course.motion_times_s, self._gaps_mm)
        axis = self._axes_base[course.place_of(float(reached[-1]))]
        key = error_key(float(times_s[-1]))
        shift = self._scene.robot_error.of_motion_mm(self._ordinal, key)
        head = self._scene.head_shift_base(self._ordinal, times_s[-1:])[0]
        return travels - gaps + float((shift - head) @ axis)

    def _look_along(self, course: CorrectedMotion) -> None:
        """Cast a ray for every sample of the motion without correction, all at once."""
        middle = int(np.argmin(np.abs(course.travels_mm)))
        nominal = self._model.T_flange_tip.inv() @ self._model.T_flange_probe
        T_tip_probe = nominal @ self._scene.world.clamping
        tips = self._model.forward(course.qs_rad[:, middle]) @ self._model.T_flange_tip
        qs_rad = course.qs_rad[:, middle]
        systematic_mm = self._scene.robot_error.systematic_mm(tips.translations, qs_rad)
        moved = tips.translations + systematic_mm
        probes = Poses(tips.rotations, moved) @ T_tip_probe
        self._axes_base = probes.rotations[:, :, 2]
        self._gaps_mm = np.full(len(course.motion_times_s), FAR_MM)
        at = course.guided
        T_skull_base = self._scene.T_base_skull.inv()
        axes_skull = T_skull_base.rotate(self._axes_base[at])
        faces_skull = T_skull_base @ probes.translations[at]
        met = self._scene.specimen.ray(faces_skull - BEFORE_MM * axes_skull, axes_skull)
        self._gaps_mm[at] = np.where(np.isfinite(met), met - BEFORE_MM, FAR_MM)
        self._course = course
