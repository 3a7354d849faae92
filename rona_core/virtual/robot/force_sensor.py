"""Virtual force sensor: gravity, contact force, offset, drift, noise and quantisation."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from rona_core.devices.protocols import Clock
from rona_core.devices.wrench import JR3, WrenchSample
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.force_control.gravity_compensation import GRAVITY_BASE, cross_matrix
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.noise import FrameNoise, rng
from rona_core.virtual.robot.contact_dynamics import INNER_S, LINE_N_PER_MM, ContactSpring

MASS_SPREAD_KG = 0.01  # over seeds, about what the tool is assumed to weigh
COM_FLANGE_MM = ((70.0, 0.0, 45.0), 4.0)
OFFSET = (1.5, 60.0)  # N and N mm, what is shown without load
NOISE = readonly(np.repeat((0.03, 2.4), 3))  # N and N mm: the same share of both ranges
LONGEST_S = 0.2  # what came earlier has left the filter
MICROSECONDS = 1e6

DepthsAt = Callable[[Floats], Floats]  # times (n,) in s -> depth (n,) in mm that the face is in


class VirtualForceSensor:
    """Satisfies ``devices.force.ForceSensor``."""

    def __init__(
        self,
        clock: Clock,
        robot_model: RobotModel,
        q_at: Callable[[float], Floats],
        depths_mm: DepthsAt,
    ) -> None:
        """Sit on the flange of a robot.

        Args:
            clock: Time of the capture.
            robot_model: The robot with its tool.
            q_at: Joint angles (6,) at a time of the capture.
            depths_mm: How deep the face is pressed in.
        """
        self.model, self._ranges = JR3, JR3.ranges
        self._steps = self._ranges / JR3.steps
        self._clock, self._robot_model, self._q_at = clock, robot_model, q_at
        self._depths_mm = depths_mm
        self._closed = False
        self.begin(0, 0)

    def begin(self, seed: int, ordinal: int) -> None:
        """Start capture number ``ordinal`` of a session with this seed, without contact."""
        generator = rng(seed, "force sensor", 0, 0)
        self.mass_kg = float(generator.normal(self._robot_model.tool.mass_kg, MASS_SPREAD_KG))
        self.com_flange_mm: Floats = COM_FLANGE_MM[0] + generator.normal(0.0, COM_FLANGE_MM[1], 3)
        spread = np.repeat(OFFSET, 3)
        self.offset = spread * generator.normal(0.0, 1.0, 6)
        self._noise = FrameNoise(seed, "force noise", ordinal)
        # wrenches: of the weight where z of ``base`` is x, y or z of the flange (6, 3), and of a
        # touch by -1 N (6,)
        T_flange_probe = self._robot_model.T_flange_probe
        axis, levers = T_flange_probe.rotation[:, 2], cross_matrix(T_flange_probe.translation)
        by_weight = np.vstack((np.eye(3), cross_matrix(self.com_flange_mm)))
        self._by_up = self.mass_kg * GRAVITY_BASE[2] * by_weight
        self._by_touch = np.concatenate((axis, levers @ axis))
        self._spring = ContactSpring(LINE_N_PER_MM, cutoff_hz=self.model.cutoff_hz)
        self._until_s = 0.0
        self._closed = False

    def read(self) -> WrenchSample:
        """Return what the sensor shows now.

        Raises:
            DeviceError: the sensor is closed.
        """
        if self._closed:
            raise DeviceError("the force sensor is closed; open a new one")
        now_s = self._clock.now()
        true = self._wrench(now_s)
        random = self._noise.at(round(now_s * MICROSECONDS))
        true += NOISE * random.standard_normal(6)
        ranges, steps = self._ranges, self._steps
        shown = true / steps
        np.rint(shown, out=shown)
        shown *= steps
        np.minimum(np.maximum(shown, -ranges, out=shown), ranges, out=shown)
        return WrenchSample(now_s, readonly(shown), bool((np.abs(true) >= ranges).any()))

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        self._closed = True

    def _wrench(self, now_s: float) -> Floats:
        looks = round((now_s - max(self._until_s, now_s - LONGEST_S)) / INNER_S)
        if looks > 0:
            self._spring.advance(self._depths_mm(now_s - _ago_s(looks)))
            self._until_s = now_s
        wrench = self._by_up @ self._robot_model.up_flange(self._q_at(now_s))
        wrench -= self._spring.shown_n * self._by_touch
        wrench += self.offset
        return wrench


@lru_cache(maxsize=64)  # every step of a control loop has as many looks
def _ago_s(looks: int) -> Floats:
    """Return how long ago (n,) each of n looks at the spring was, the last one now."""
    return readonly(INNER_S * np.arange(looks - 1.0, -0.5, -1.0))
