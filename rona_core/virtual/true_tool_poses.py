"""True poses of tool, probe and pointer at any time of a capture."""

from collections.abc import Callable

from rona_core.devices.settings import SONO
from rona_core.geometry.pose import Pose
from rona_core.virtual.operator.manual_pivot import ManualPivot
from rona_core.virtual.pointer_motion import HandMotion
from rona_core.virtual.scene import VirtualScene

REPEAT_S = 0.5  # the robot's repeatability error changes this often

TipAt = Callable[[float], Pose]  # time in seconds -> T_base_tip as the encoders say


def error_key(time_s: float) -> int:
    """Return the time bucket that the robot's repeatability error belongs to."""
    return int(time_s // REPEAT_S)


class MovingTools:
    """True poses as functions of the time of one capture."""

    def __init__(
        self,
        scene: VirtualScene,
        ordinal: int,
        tip_at: TipAt,
        hand: Callable[[], HandMotion | ManualPivot | None],
    ) -> None:
        """Follow the robot through ``tip_at`` and the pointer through ``hand()``."""
        self._scene = scene
        self._ordinal = ordinal
        self._tip_at = tip_at
        self._hand = hand
        self._T_tracker_base = scene.T_base_tracker.inv()
        self._T_skull_base = scene.T_base_skull.inv()
        self._T_tracker_basemarker = self._T_tracker_base @ scene.T_base_basemarker
        self._last: tuple[Pose, int, Pose] | None = None  # spares work while the robot rests

    def T_base_tip(self, time_s: float) -> Pose:  # noqa: N802 (frame grammar)
        """Return where the tool's tip really is."""
        nominal, key = self._tip_at(time_s), error_key(time_s)
        last = self._last
        if last is None or last[0] is not nominal or last[1] != key:
            last = nominal, key, self._scene.T_base_tip_true(nominal, self._ordinal, key)
            self._last = last
        return last[2]

    def T_skull_tip(self, time_s: float) -> Pose:  # noqa: N802 (frame grammar)
        """Return the pose of the tool's tip relative to the specimen."""
        return self._T_skull_base @ self.T_base_tip(time_s)

    def T_base_pointermarker(self, time_s: float) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the pointer is, None while it lies aside."""
        hand = self._hand()
        return None if hand is None else hand.T_base_pointermarker(time_s)

    def T_skull_probe(self, time_s: float) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return the pose of the probe while somebody holds it in the hand, None otherwise."""
        hand = self._hand()
        if hand is None or hand.pointer != SONO:
            return None
        T_base_marker = hand.T_base_pointermarker(time_s)
        return self._T_skull_base @ (T_base_marker @ self._scene.T_sonomarker_probe)

    def T_tracker_marker(self, tool: str, time_s: float) -> Pose | None:  # noqa: N802
        """Return the true pose of a tool's marker before the tracker, None if it is not there."""
        if tool == "basemarker":
            return self._T_tracker_basemarker
        hand = self._hand()
        if tool == "toolmarker":
            return self._T_tracker_base @ (self.T_base_tip(time_s) @ self._scene.T_tip_toolmarker)
        if hand is None or hand.pointer != tool:
            return None
        return self._T_tracker_base @ hand.T_base_pointermarker(time_s)
