"""True poses of tool, probe and pointer at any time of a capture."""

from collections.abc import Callable

import numpy as np

from rona_core.devices.settings import SONO
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_core.virtual.operator.manual_pivot import ManualPivot
from rona_core.virtual.pointer_motion import HandMotion
from rona_core.virtual.scene import VirtualScene

REPEAT_S = 0.5  # the robot's repeatability error changes this often

# times (n,) in seconds -> joint angles (n, 6) and Ts_base_tip (n,), as the encoders say
TipsAt = Callable[[Floats], tuple[Floats, Poses]]


def error_keys(times_s: Floats) -> Ints:
    """Return the time buckets (n,) that the robot's repeatability error belongs to."""
    return np.asarray(times_s // REPEAT_S).astype(np.int64)


def error_key(time_s: float) -> int:
    """Return that of one time: a contact loop asks every step."""
    return int(time_s // REPEAT_S)


class MovingTools:
    """True poses as functions of the time of one capture."""

    def __init__(
        self,
        scene: VirtualScene,
        ordinal: int,
        tips_at: TipsAt,
        hand: Callable[[], HandMotion | ManualPivot | None],
    ) -> None:
        """Follow the robot through ``tips_at`` and the pointer through ``hand()``."""
        self._scene = scene
        self._ordinal = ordinal
        self._tips_at = tips_at
        self._hand = hand
        self._T_tracker_base = scene.T_base_tracker.inv()
        self._T_skull_base = scene.T_base_skull.inv()
        self._T_tracker_basemarker = self._T_tracker_base @ scene.T_base_basemarker

    def Ts_base_tip(self, times_s: Floats) -> Poses:  # noqa: N802 (frame grammar)
        """Return where the tool's tip really is at times (n,)."""
        qs_rad, nominal = self._tips_at(times_s)
        keys = error_keys(times_s)
        return self._scene.Ts_base_tip_true(nominal, qs_rad, self._ordinal, keys)

    def Ts_skull_tip(self, times_s: Floats) -> Poses:  # noqa: N802 (frame grammar)
        """Return the poses (n,) of the tool's tip relative to the specimen."""
        return self._in_skull(self.Ts_base_tip(times_s), times_s)

    def T_base_pointermarker(self, time_s: float) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the pointer is, None while it lies aside."""
        hand = self._hand()
        return None if hand is None else hand.Ts_base_pointermarker(np.array([time_s]))[0]

    def Ts_skull_probe(self, times_s: Floats) -> Poses | None:  # noqa: N802 (frame grammar)
        """Return the poses (n,) of the probe while it is held in the hand, None otherwise."""
        hand = self._hand()
        if hand is None or hand.pointer != SONO:
            return None
        markers = hand.Ts_base_pointermarker(times_s)
        return self._in_skull(markers @ self._scene.T_sonomarker_probe, times_s)

    def _in_skull(self, poses_base: Poses, times_s: Floats) -> Poses:
        """Return poses (n,) relative to the specimen, where the head is at these times."""
        shifts = self._scene.head_shift_base(self._ordinal, times_s)
        if not shifts.any():
            return self._T_skull_base @ poses_base
        moved = poses_base.translations - shifts
        return self._T_skull_base @ Poses.unchecked(poses_base.rotations, moved)

    def _Ts_base_headmarker(self, times_s: Floats) -> Poses:  # noqa: N802 (frame grammar)
        """Return the poses (n,) of the marker on the head, which goes with it."""
        rest = self._scene.T_base_headmarker.repeated(len(times_s))
        shifts = self._scene.head_shift_base(self._ordinal, times_s)
        return Poses.unchecked(rest.rotations, rest.translations + shifts)

    def Ts_tracker_marker(self, tool: str, times_s: Floats) -> Poses | None:  # noqa: N802
        """Return the true poses (n,) of a tool's marker before the tracker, None if not there."""
        if tool == "basemarker":
            return self._T_tracker_basemarker.repeated(len(times_s))
        if tool == "headmarker":
            return self._T_tracker_base @ self._Ts_base_headmarker(times_s)
        hand = self._hand()
        if tool == "toolmarker":
            return self._T_tracker_base @ (self.Ts_base_tip(times_s) @ self._scene.T_tip_toolmarker)
        if hand is None or hand.pointer != tool:
            return None
        return self._T_tracker_base @ hand.Ts_base_pointermarker(times_s)
