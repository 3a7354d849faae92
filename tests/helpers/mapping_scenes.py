"""Detections with known errors on a known dome, without any echoes: the input of the maps."""

import numpy as np

from rona_core.geometry.pose import Pose, Poses
from rona_core.ultrasound.detection.detect import OK, UNSURE, Detection
from tests.helpers.ultrasound_scenes import WavySkull

T_BASE_SKULL = Pose.from_rotvec((2.1, -0.8, 0.4), (620.0, -140.0, 310.0))


def survey(
    skull: WavySkull,
    rng,
    *,
    radius_mm=20.0,
    lines_mm=2.0,
    pitch_mm=1.0,
    outer_sd_mm=0.05,
    inner_sd_mm=0.15,
    flagged=0.3,
    wrong=0.02,
    late_mm=0.0,
    gap=None,
    T_base_skull=T_BASE_SKULL,
):
    """Return a detection of a meander over a disc, and the poses of the probe.

    ``flagged`` of the inner echoes are rubbish and say so, ``wrong`` are rubbish and do not.
    """
    rows = np.arange(-radius_mm, radius_mm + 1e-9, lines_mm)
    along = np.arange(-radius_mm, radius_mm + 1e-9, pitch_mm)
    xy = np.array(
        [(x, y) for i, y in enumerate(rows) for x in (along if i % 2 == 0 else along[::-1])]
    )
    keep = np.hypot(*xy.T) <= radius_mm
    if gap is not None:
        keep &= ~gap(xy)
    xy = xy[keep]
    n = len(xy)
    poses = [skull.pose(p, tilt_rad=rng.normal(0.0, 0.015, 2)) for p in xy]
    axes = np.array([pose.rotation[:, 2] for pose in poses])
    origins = np.array([pose.translation for pose in poses])
    found = skull.layers(origins - 10.0 * axes, axes)
    standoff = found[:, 0] - 10.0 + rng.normal(0.0, outer_sd_mm, n) + late_mm
    thickness = found[:, 3] - found[:, 0] + rng.normal(0.0, inner_sd_mm, n)
    flag = np.where(rng.uniform(size=n) < flagged, UNSURE, OK)
    rubbish = (flag != OK) | (rng.uniform(size=n) < wrong)
    thickness = np.where(rubbish, rng.uniform(2.0, 12.0, n), thickness)
    ones, zeros = np.ones(n), np.zeros(n)
    detection = Detection(
        outer_us=zeros, inner_us=zeros, outer_ok=ones > 0, inner_ok=flag == OK,
        outer_quality=ones, inner_quality=np.where(flag == OK, 1.0, 0.3), flag=flag,
        standoff_mm=standoff, thickness_mm=thickness, outer_sigma_mm=0.01 * ones,
        thickness_sigma_mm=0.1 * ones, inner_sigma_us=0.08 * ones, alternative_us=zeros,
        alternative_quality=zeros, probe="2.25MHz", excitation="chirp",
        method="subtract", sound_speed_mm_per_us=2.65,
    )  # fmt: skip
    return detection, T_base_skull @ Poses.stack(poses)


def cloud(skull, rng, n, *, radius_mm=26.0, sd_mm=0.3, T_error=None, T_base_skull=T_BASE_SKULL):
    """Return pointer points (n, 3) in base; ``T_error`` displaces all of them, in skull."""
    r, a = radius_mm * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * np.pi, n)
    xy = np.column_stack((r * np.cos(a), r * np.sin(a)))
    points = np.column_stack((xy, skull.outer_z(xy))) + rng.normal(0.0, sd_mm, (n, 3))
    return T_base_skull @ (points if T_error is None else T_error @ points)


def errors_mm(boundary, truth_z, mask=None, T_base_skull=T_BASE_SKULL):
    """Return how far (k,) the ok cells lie outside the true boundary z(x, y), along z of the skull.

    The dome is shallow, so this is within 4 % of the distance along the normal.
    """
    ok = boundary.ok if mask is None else boundary.ok & mask
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    points = np.stack((u[ok], v[ok], boundary.height_mm[ok]), axis=1)
    skull = T_base_skull.inv() @ (boundary.T_base_map @ points)
    return truth_z(skull[:, :2]) - skull[:, 2]
