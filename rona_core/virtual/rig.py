"""Virtual rig: all virtual devices of one session around one scene and one clock."""

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.protocols import DrawnHead, Origin
from rona_core.devices.settings import DeviceSettings
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, as_vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.acoustics.medium import bone_medium
from rona_core.virtual.acoustics.plates import VirtualBench
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.operator.manual_pivot import ManualPivot
from rona_core.virtual.operator.operator import VirtualOperator
from rona_core.virtual.robot.accuracy_error import RobotError
from rona_core.virtual.robot.contact_depth import ContactDepth
from rona_core.virtual.robot.force_sensor import VirtualForceSensor
from rona_core.virtual.robot.joint_errors import JointErrors
from rona_core.virtual.robot.robot import VirtualRobot
from rona_core.virtual.robot.seated_motion import Seated, seated_postures
from rona_core.virtual.robot.taught_landmarks import teach_landmarks
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.live_tracker import VirtualLiveTracker
from rona_core.virtual.tracker.occlusion import LinesOfSight, Sight
from rona_core.virtual.tracker.tracker import VirtualTracker
from rona_core.virtual.true_tool_poses import MovingTools
from rona_core.virtual.world.world import NOMINAL, World

EDGE_MM = 3.5  # of the triangles that the skull is drawn with
SLIDE_S, SLIDE_MM = 0.02, 0.01  # time over which the face is seen to slide, and least way
if TYPE_CHECKING:
    from rona_core.virtual.specimen.build_specimen import Specimen


class VirtualDisplay:
    """Shows the scene; satisfies ``devices.Display``."""

    def __init__(self, scene: VirtualScene, pointer: Callable[[], Pose | None]) -> None:
        """Draw ``scene``; ``pointer()`` returns where the pointer is now."""
        self._scene = scene
        self._pointer = pointer

    def begin(self, scene: VirtualScene) -> None:
        """Draw this scene from now on."""
        self._scene = scene

    def skull_mesh_base(self) -> Mesh:
        """Return the outer surface of the specimen in ``base``."""
        mesh = self._scene.specimen.mesh(EDGE_MM)
        return Mesh(self._scene.T_base_skull @ mesh.vertices, mesh.faces)

    def drawn_head_base(self) -> DrawnHead | None:
        """Return the head in ``base``; None where the specimen has none but its surface."""
        head = self._scene.specimen.drawn_head(EDGE_MM)
        if head is None:
            return None
        place = self._scene.T_base_skull
        return DrawnHead(
            Mesh(place @ head.calvaria.vertices, head.calvaria.faces),
            Mesh(place @ head.face.vertices, head.face.faces),
            head.shades,
            (place @ head.sutures.reshape(-1, 3)).reshape(-1, 2, 3),
        )

    def pick(self, origin_base: ArrayLike, direction_base: ArrayLike) -> Vector3 | None:
        """Return where a ray of sight meets the skull (3,) in ``base``, or None if it misses.

        Raises:
            InvalidInputError: the direction has no length.
        """
        origin = as_vector3(origin_base, name="origin_base")
        direction = as_vector3(direction_base, name="direction_base")
        length = np.linalg.norm(direction)
        if length <= 0.0:
            raise InvalidInputError("direction_base must not be (0, 0, 0)")
        direction = direction / length
        T_skull_base = self._scene.T_base_skull.inv()
        rays = (T_skull_base @ origin)[None], T_skull_base.rotate(direction)[None]
        distance_mm = float(self._scene.specimen.ray(*rays)[0])
        return origin + distance_mm * direction if np.isfinite(distance_mm) else None

    def point_mesh(self, point_base: ArrayLike) -> Vector3:
        """Return a place of ``base`` (3,) in ``mesh``: the coordinates of the specimen."""
        point = as_vector3(point_base, name="point_base")
        return self._scene.T_base_skull.inv() @ point

    def region(self) -> tuple[Vector3, Vector3, float]:
        """Return centre (3,), outward normal (3,) in ``base`` and radius in mm of the region."""
        return self._scene.region_base()

    def head_axes_base(self) -> Floats | None:
        """Return right, front and top of the head as unit columns (3, 3), or None."""
        axes_skull = self._scene.specimen.head_axes_skull
        if axes_skull is None:
            return None
        return self._scene.T_base_skull.rotate(axes_skull.T).T

    def T_base_tracker(self) -> Pose:  # noqa: N802 (frame grammar)
        """Return where the tracker stands."""
        return self._scene.T_base_tracker

    def T_base_basemarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the marker on the robot base is."""
        return self._scene.T_base_basemarker

    def T_base_pointermarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the pointer is now; None while it lies aside."""
        return self._pointer()


def build_scene(
    seed: int, specimen: "Specimen", settings: DeviceSettings, world: World
) -> VirtualScene:
    """Return the ground truth of a session with virtual devices.

    Raises:
        InvalidInputError: no robot of the name in the settings.
    """
    model = robot_model(settings.robot.model)
    joints = JointErrors(seed, model, world.robot_mm) if world.robot_joints else None
    return VirtualScene(
        seed,
        specimen,
        settings,
        robot_error=RobotError(seed, settings.robot.errors, world.robot_mm, joints),
        T_tip_toolmarker=model.T_flange_tip.inv() @ model.T_flange_toolmarker,
        region_center=model.work_area.region_base,
        world=world,
    )


class VirtualRig:
    """The virtual devices; satisfies ``devices.Rig``.

    Everything that is measured follows from the seed, the specimen, the settings and the ordinal of
    the capture. ``speed`` is the pace at which captures are shown, see ``CaptureClock``;
    ``world`` is what patient and devices really are.
    """

    origin: Origin = "VIRTUAL"

    def __init__(
        self,
        seed: int,
        specimen: "Specimen",
        settings: DeviceSettings,
        speed: float | None = None,
        world: World = NOMINAL,
    ) -> None:
        """Build the scene and switch the devices on, ready for capture 0."""
        self.scene = build_scene(seed, specimen, settings, world)
        self.clock = CaptureClock(speed)
        self._model = robot_model(settings.robot.model)
        self.robot = VirtualRobot(self._model, self.clock, self._in_seat)
        self.operator = VirtualOperator(self.scene, self.clock)
        self._tools = self._moving_tools(0)
        self._sight = self._lines_of_sight()
        self.tracker = VirtualTracker(self.clock, self, seed, share=world.tracker_share)
        self.live_tracker = VirtualLiveTracker(
            seed,
            lambda: self._marker_now("toolmarker"),
            lambda: self._marker_now("basemarker"),
            lambda: self._marker_now("headmarker"),
            clear=self._clear_now,
            share=world.tracker_share,
        )
        self.probe = VirtualProbe(
            self.clock,
            self._true_probes,
            specimen,
            bone_medium(world),
            world=world,
            sliding=self._sliding if world.friction else None,
        )
        self.force = self._force_sensor()
        self.bench = VirtualBench(self.scene, lambda scene: teach_landmarks(scene, self._model))
        self.display = VirtualDisplay(self.scene, self._pointer_now)
        self.begin(settings, 0)

    def begin(self, settings: DeviceSettings, ordinal: int) -> None:
        """Configure every device for capture number ``ordinal`` and set the clock to 0.

        Raises:
            InvalidInputError: no robot of the name in the settings.
        """
        if settings != self.scene.settings:
            old = self.scene
            scene = build_scene(old.seed, old.specimen, settings, old.world)
            if settings.robot.model != self.scene.settings.robot.model:
                self._model = robot_model(settings.robot.model)
                self.robot = VirtualRobot(self._model, self.clock, self._in_seat)
                self.force = self._force_sensor()
            self.scene = scene
            self._sight = self._lines_of_sight()
        self.robot.stop()  # a motion under way ends where it is, not where it was going
        self.clock.reset()
        self.robot.begin(settings.robot, ordinal)
        self.operator.begin(self.scene, settings, ordinal)
        self.tracker.begin(settings.tracker, ordinal)
        self.probe.begin(settings.probe, self.scene.seed, ordinal)
        self._touch = ContactDepth(self.scene, self._model, ordinal)
        self.force.begin(self.scene.seed, ordinal)
        self.bench.begin(self.scene, ordinal)
        self.display.begin(self.scene)
        self._tools = self._moving_tools(ordinal)

    def close(self) -> None:
        """Release all devices and end all waits; a second call does nothing."""
        self.clock.interrupt()
        self.tracker.close()
        self.robot.close()
        self.probe.close()
        self.force.close()

    @property
    def model(self) -> RobotModel:
        """The robot, as the planner knows it."""
        return self._model

    def _moving_tools(self, ordinal: int) -> MovingTools:
        return MovingTools(self.scene, ordinal, self._tips_at, self.operator.motion)

    def _lines_of_sight(self) -> LinesOfSight:
        return LinesOfSight(self.scene, self._model, lambda times_s: self.robot.qs_at(times_s))

    def _force_sensor(self) -> VirtualForceSensor:
        return VirtualForceSensor(
            self.clock, self._model, lambda time_s: self.robot.q_at(time_s), self._depths_mm
        )

    def _in_seat(self, times_s: Floats, qs_rad: Floats, seated: Seated) -> Floats:
        return seated_postures(self.scene, self._model, times_s, qs_rad, seated)

    def _depths_mm(self, times_s: Floats) -> Floats:
        return self._touch.depths_mm(self.robot.guided, times_s)

    def Ts_tracker_marker(  # noqa: N802 (frame grammar)
        self, tool: str, times_s: Floats
    ) -> Poses | None:
        """Return the true poses (n,) of a tool before the tracker, None if it is not there."""
        return self._tools.Ts_tracker_marker(tool, times_s)

    def sight(self, times_s: Floats) -> Sight:
        """Return the visibility of markers (n, m) of a tool at its true poses by both cameras."""
        return self._sight.at(times_s)

    def motion_key(self) -> Hashable | None:
        """Return what decides all motion to come, None while it answers to what happens."""
        robot, hand = self.robot.motion_key(), self.operator.motion()
        return None if robot is None or isinstance(hand, ManualPivot) else (robot, hand)

    def _clear_now(self, tool: str, Ts_tracker_marker: Poses) -> Bools:
        return self.sight(self._now_s())(tool, Ts_tracker_marker)

    def _now_s(self) -> Floats:
        return np.array([self.clock.now()])

    def _tips_at(self, times_s: Floats) -> tuple[Floats, Poses]:
        qs_rad = self.robot.qs_at(times_s)
        return qs_rad, self._model.forward(qs_rad) @ self._model.T_flange_tip

    def _marker_now(self, tool: str) -> Pose | None:
        poses = self._tools.Ts_tracker_marker(tool, self._now_s())
        return None if poses is None else poses[0]

    def _true_probes(self, times_s: Floats) -> Poses:
        """Return the poses (n,) of the face relative to the specimen."""
        held = self._tools.Ts_skull_probe(times_s)
        if held is not None:
            return held
        return self._tools.Ts_skull_tip(times_s) @ self._T_tip_probe()

    def _T_tip_probe(self) -> Pose:  # noqa: N802 (frame grammar)
        """Return the probe as it is clamped."""
        model, clamped = self._model, self.scene.world.clamping
        return model.T_flange_tip.inv() @ model.T_flange_probe @ clamped

    def _sliding(self, times_s: Floats) -> Floats:
        """Return the directions (n, 3) in ``skull`` in which the face of the probe slides."""
        T_tip_probe = self._T_tip_probe()
        tips = self._tools.Ts_skull_tip(times_s)
        before = self._tools.Ts_skull_tip(times_s - SLIDE_S) @ T_tip_probe
        axes = tips.rotations[:, :, 2]
        steps = (tips @ T_tip_probe).translations - before.translations
        steps = steps - np.vecdot(steps, axes)[:, None] * axes
        lengths = np.sqrt(np.vecdot(steps, steps))
        return steps / np.maximum(lengths, SLIDE_MM)[:, None]

    def _pointer_now(self) -> Pose | None:
        return self._tools.T_base_pointermarker(self.clock.now())
