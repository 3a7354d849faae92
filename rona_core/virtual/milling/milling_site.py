"""The virtual milling site: true bone, burr, force sensor and probe; satisfies ``MillingSite``."""

import numpy as np

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.planning.rehearsal.site import BurrWay, ForceReading, ProbeWay
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.acoustics.medium import bone_medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.milling.hardness import draw_force, measured
from rona_core.virtual.milling.left_bone import LeftBone
from rona_core.virtual.milling.milled_skull import MilledSkull
from rona_core.virtual.milling.true_burr import true_centers_bed
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.true_tool_poses import error_keys

AROUND_MM = 1.0  # of the grid round the way
PRESSED_MM = 0.15  # rms of how far the line is pressed in, off what is asked for
PERIOD_S = 0.02
FIRST_ORDINAL = 100_000  # no capture of a session has such an ordinal
BEHIND_MM = 10.0  # rays along an axis start this far before the face


class VirtualMillingSite:
    """One bone, whole at first.

    Attributes:
        least_mm: Shortest way from the burr to the true inner boundary at each step so far,
            negative where it was through. Only the evaluation may look at it.
        scanned_mm: True bone (m,) below the faces of the floor that was scanned last, along their
            axes; None before that. Only the evaluation may look at it.
    """

    def __init__(self, scene: VirtualScene, model: RobotModel, number: int) -> None:
        """Put the bone of a scene before a robot; noise differs with the number."""
        self._scene, self._model, self._ordinal = scene, model, FIRST_ORDINAL + number
        self._force = draw_force(scene.seed)
        self._random = rng(scene.seed, "milling", self._ordinal, 0)
        self._T_skull_bed, self._fitted = Pose.identity(), 0
        self._left: LeftBone | None = None
        self.least_mm: list[float] = []
        self.scanned_mm: Floats | None = None

    def follow(self, way: BurrWay) -> None:
        """Make ready for a way, its first place the next; the bone stays as it was left."""
        self._way, self._next = way, 0
        self._centers = true_centers_bed(self._scene, self._model, way, self._ordinal, self._fitted)
        self._fitted += 1
        self._steps_mm = way.steps_mm()
        if self._left is None:
            self._T_skull_bed = self._scene.T_base_skull.inv() @ way.T_base_bed
            reach = np.abs(way.bottoms_bed[:, :2]).max() + way.radii_mm.max()
            specimen = self._scene.specimen
            self._left = LeftBone(specimen, self._T_skull_bed, float(reach) + AROUND_MM)
        self._to_inner_mm = self._left.distances_to_inner_mm(self._centers, way.radii_mm)

    def left_bone(self) -> LeftBone:
        """Return what is left of the bone; only the evaluation may look at it.

        Raises:
            DeviceError: no way was followed yet.
        """
        if self._left is None:
            raise DeviceError("nothing is known to be milled: follow a way first")
        return self._left

    def advance(self, feed_mm_per_s: float) -> ForceReading:
        """Drive to the next place of the way."""
        row = self._next
        self._next += 1
        center, radius = self._centers[row], float(self._way.radii_mm[row])
        volumes = self.left_bone().cut(center, radius)
        self.least_mm.append(float(self._to_inner_mm[row]))
        step_mm = float(self._steps_mm[row])
        areas = volumes / step_mm
        force = self._force.of(areas, center, feed_mm_per_s)
        bone = self._force.of(areas * (1.0, 1.0, 1.0, 0.0), center, feed_mm_per_s)
        mean, sigma = measured(force, bone, step_mm / feed_mm_per_s, self._random)
        return ForceReading(mean, sigma)

    def drive(self) -> None:
        """Drive along the rest of the path without a force."""
        rows = slice(self._next, len(self._way))
        self.left_bone().cut_along(self._centers[rows], self._way.radii_mm[rows])
        self.least_mm += self._to_inner_mm[rows].tolist()
        self._next = len(self._way)

    def scan_floor(self, way: ProbeWay) -> AScanTrack:
        """Return an A-scan for each place, with the probe pressed on the floor along its axis."""
        scene, settings = self._scene, self._scene.settings.probe
        skull = MilledSkull(scene.specimen, self._T_skull_bed, self.left_bone())
        poses = self._pressed(skull, self._true_probes(way))
        axes = poses.rotations[:, :, 2]
        met = skull.layers(poses.translations - BEHIND_MM * axes, axes)
        self.scanned_mm = met[:, 3] - met[:, 0]
        clock = CaptureClock()

        def held(times_s: Floats) -> Poses:
            rows = np.clip(np.rint(times_s / PERIOD_S).astype(np.int64) - 1, 0, len(poses) - 1)
            return poses.select(rows)

        medium = bone_medium(scene.world)
        probe = VirtualProbe(clock, held, skull, medium, world=scene.world)
        probe.begin(settings, scene.seed, self._ordinal)
        for number in range(len(poses)):
            clock.wait_until(PERIOD_S * (number + 1))
            probe.fire()
        scans: list[AScan] = probe.collect()
        probe.close()
        return AScanTrack.from_scans(scans)

    def _true_probes(self, way: ProbeWay) -> Poses:
        """Return where the face is before it is pressed on, in ``skull``."""
        scene = self._scene
        model = robot_model(scene.settings.robot.model)  # with the probe in place of the spindle
        tips = model.forward(way.qs_rad) @ model.T_flange_tip
        keys = error_keys(way.times_s)
        true = scene.Ts_base_tip_true(tips, way.qs_rad, self._ordinal, keys)
        return scene.T_base_skull.inv() @ true @ scene.world.clamping

    def _pressed(self, skull: MilledSkull, poses: Poses) -> Poses:
        """Return faces (n,) that force control has brought to the floor."""
        axes = poses.rotations[:, :, 2]
        gap = skull.layers(poses.translations - BEHIND_MM * axes, axes)[:, 0] - BEHIND_MM
        off = self._random.normal(0.0, PRESSED_MM, len(gap))
        return Poses(poses.rotations, poses.translations + (gap + off)[:, None] * axes)
