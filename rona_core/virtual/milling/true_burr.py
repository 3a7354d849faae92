"""Where the burr really is while the encoders say where it should be."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.planning.rehearsal.site import BurrWay
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.true_tool_poses import error_keys

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
