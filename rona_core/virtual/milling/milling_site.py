"""The virtual milling site: true bone, burr, force sensor and probe; satisfies ``MillingSite``.

How hard a patient's bone is to cut, layer by layer, and how the force on the burr follows. The
outer table is the hardest (Peterson 2002: denser and stiffer than the inner one); the diploe varies
most (McElhaney 1970). Forces and noise themselves are assumed: no source gives them for a ball burr
in the calvaria.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.planning.rehearsal.site import BurrWay, ForceReading, ProbeWay
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.acoustics.medium import bone_medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.milling.left_bone import CELL_MM, LeftBone
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.specimen.boundaries import Specimen
from rona_core.virtual.true_tool_poses import error_keys

ROUNDS = 3  # of finding the floor along a ray that is nearly plumb to it


class MilledSkull:
    """What a probe meets after the burr: the boundaries below the floor, and the floor."""

    def __init__(self, specimen: Specimen, T_skull_bed: Pose, left: LeftBone) -> None:
        """Look at a skull of which this is left."""
        self._specimen, self._T_bed_skull, self._left = specimen, T_skull_bed.inv(), left

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return the distances (n, 4) of the boundaries along rays, none above the floor."""
        found = self._specimen.layers(origins_skull, directions_skull)
        starts = self._T_bed_skull @ origins_skull
        along = self._T_bed_skull.rotate(directions_skull)
        way = np.where(np.isfinite(found[:, 0]), found[:, 0], 0.0)
        for _ in range(ROUNDS):
            place = starts + way[:, None] * along
            cells = (place[:, :2] - (self._left.x_mm[0], self._left.y_mm[0])) / CELL_MM
            height = map_coordinates(self._left.top_mm, cells.T, order=1, mode="nearest")
            way = way + (height - place[:, 2]) / along[:, 2]
        return np.maximum(found, np.where(np.isfinite(way), way, 0.0)[:, None])


SEAT_MM = 0.05  # per axis: how a burr sits in its chuck, each one as it was put in


def true_tips(scene: VirtualScene, model: RobotModel, way: BurrWay, ordinal: int) -> Poses:
    """Return the true poses (n,) of the spindle's tip in ``base``, seen from the head at rest.

    Errors of the robot and motion of the head come in here; those of the maps by the way itself.
    """
    postures = (model.forward(way.qs_rad) @ model.T_flange_tip).rotations
    axes = way.T_base_bed.inv().rotate(postures[:, :, 2])
    tips_bed = way.bottoms_bed + way.radii_mm[:, None] * (axes + (0.0, 0.0, 1.0))
    commanded = Poses(postures, way.T_base_bed @ tips_bed)
    true = scene.Ts_base_tip_true(commanded, way.qs_rad, ordinal, error_keys(way.times_s))
    shifts = scene.head_shift_base(ordinal, way.times_s)
    return Poses(true.rotations, true.translations - shifts)


def true_centers_bed(
    scene: VirtualScene, model: RobotModel, way: BurrWay, ordinal: int, fitted: int = 0
) -> Floats:
    """Return the middles of the ball (n, 3) in ``bed``, as that lies on the head at rest.

    The burrs are in the chuck for the ``fitted``-th time: the probe was there in between. The
    spindle is off as far as its registration, which the model holds, does not know.
    """
    tips = true_tips(scene, model, way, ordinal)
    off = scene.world.spindle_off_tip - np.array(model.tool.burr_offset_tip)
    seats = np.zeros((len(way), 3))
    for radius in np.unique(way.radii_mm):
        random = rng(scene.seed, "burr seat", ordinal, 1000 * fitted + round(100.0 * radius))
        seats[way.radii_mm == radius] = random.normal(0.0, SEAT_MM, 3)
    middles = off + seats - way.radii_mm[:, None] * (0.0, 0.0, 1.0)
    places = tips.translations + np.einsum("nij,nj->ni", tips.rotations, middles)
    return way.T_base_bed.inv() @ places


SPECIFIC_N_PER_MM2 = 5.0  # of chip section in the outer table, at the feed below
SPECIFIC_SPREAD = 0.25  # of its logarithm: sharpness of the burr, and the patient
FULL_FEED_MM_PER_S = 4.0
FEED_POWER = 0.62  # thin chips cost more than thick ones, per volume
DIPLOE_RANGE = (0.25, 0.6)  # over the outer table
INNER_TABLE_RANGE = (0.85, 1.0)
DURA = 0.02
TEXTURE, TEXTURE_MM = 0.10, 3.0  # relative rms of the hardness from place to place; its length
WAVES = 24
SENSOR_N = 0.15  # rms of one reading
CHATTER = 0.12  # rms over the force in bone, as every tooth bites; soft tissue has none
READINGS_HZ = 100.0  # that are independent of each other


@dataclass(frozen=True, slots=True, eq=False)
class CuttingForce:
    """The force that one patient's bone puts up against the burr."""

    specific_n_per_mm2: float
    shares: Floats  # (4,) of outer table, diploe, inner table, dura
    waves_per_mm: Floats  # (k, 3) of the texture
    phases: Floats  # (k,)

    def of(self, areas_mm2: Floats, place_bed: Floats, feed_mm_per_s: float) -> float:
        """Return the mean force in N on a chip with so much section (4,) in each layer."""
        wave = np.cos(self.waves_per_mm @ place_bed + self.phases).sum()
        texture = 1.0 + TEXTURE * float(wave) * np.sqrt(2.0 / WAVES)
        feed = (feed_mm_per_s / FULL_FEED_MM_PER_S) ** FEED_POWER
        return float(self.specific_n_per_mm2 * texture * feed * (self.shares @ areas_mm2))


def draw_force(seed: int) -> CuttingForce:
    """Return the cutting force of the patient with this seed."""
    random = rng(seed, "cutting force", 0, 0)
    diploe, inner = random.uniform(*DIPLOE_RANGE), random.uniform(*INNER_TABLE_RANGE)
    return CuttingForce(
        float(SPECIFIC_N_PER_MM2 * np.exp(random.normal(0.0, SPECIFIC_SPREAD))),
        readonly(np.array((1.0, diploe, inner, DURA))),
        readonly(random.normal(0.0, 1.0 / TEXTURE_MM, (WAVES, 3))),
        readonly(random.uniform(0.0, 2.0 * np.pi, WAVES)),
    )


def measured(
    force_n: float, bone_n: float, duration_s: float, random: np.random.Generator
) -> tuple[float, float]:
    """Return mean and sigma of the readings of a force over some time.

    Args:
        force_n: True mean.
        bone_n: What of it comes from bone: that part alone chatters.
        duration_s: How long it is read.
        random: For the noise.
    """
    sigma = float(np.hypot(SENSOR_N, CHATTER * bone_n))
    count = max(READINGS_HZ * duration_s, 2.0)
    mean = force_n + random.normal(0.0, sigma / np.sqrt(count))
    spread = sigma * np.sqrt(random.chisquare(count) / count)
    return float(mean), float(spread)


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
