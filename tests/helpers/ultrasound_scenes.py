"""Small specimens with known boundaries for the tests of ultrasound: bone lies towards +z."""

import os
from pathlib import Path

import numpy as np
import pytest

from rona_core.devices.samples import AScanTrack
from rona_core.geometry.pose import Pose, Poses
from rona_core.virtual.acoustics.probe import VirtualProbe

SHARED = Path(
    os.environ.get("RONA_SHARED", str(Path(__file__).resolve().parents[2].parent / "shared"))
)


def kwave(name):
    """Return a reference field, or skip the test."""
    path = SHARED / "data" / "kwave" / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"reference field {path} is not here")
    return np.load(path)


class StillClock:
    """A clock that stands where it is put."""

    def __init__(self, time_s=0.0):
        self.time_s = time_s

    def now(self):
        return self.time_s

    def wait_until(self, time_s):
        self.time_s = time_s


class Plates:
    """Four planes z = depth + slope . (x, y)."""

    def __init__(self, depths=(0.0, 1.8, 4.2, 6.0), inner_slope=(0.0, 0.0)):
        self.depths = np.array(depths)
        self.slopes = np.zeros((4, 2))
        self.slopes[3] = inner_slope

    def layers(self, origins_skull, directions_skull):
        o, u = origins_skull, directions_skull
        height = self.depths + o[:, :2] @ self.slopes.T
        with np.errstate(divide="ignore"):
            s = (height - o[:, 2:]) / (u[:, 2:] - u[:, :2] @ self.slopes.T)
        return np.where(s > 0, s, np.inf)


class Shells:
    """Concentric spheres about (0, 0, radius): the outermost touches the origin."""

    def __init__(self, radius_mm, depths=(0.0, 1.8, 4.2, 6.0)):
        self.radius_mm, self.depths = radius_mm, np.array(depths)

    def layers(self, origins_skull, directions_skull):
        o = origins_skull - (0.0, 0.0, self.radius_mm)
        b = np.einsum("ni,ni->n", o, directions_skull)[:, None]
        c = (o**2).sum(axis=1)[:, None] - (self.radius_mm - self.depths) ** 2
        root = b**2 - c
        with np.errstate(invalid="ignore"):
            s = -b - np.sqrt(root)
        return np.where((root > 0) & (s > 0), s, np.inf)


class WavySkull:
    """A dome whose inner table is not parallel to the outer: tilt about 7 deg median, 17 p90."""

    LENGTHS_MM, SDS_MM = (45.0, 19.0, 7.5), (0.7, 0.2, 0.05)

    def __init__(self, seed, mean_mm=6.0, radius_mm=80.0, roughness=1.0):
        rng = np.random.default_rng(seed)
        self.mean_mm, self.radius_mm = mean_mm, radius_mm
        waves, phases, sizes = [], [], []
        for length, sd in zip(self.LENGTHS_MM, self.SDS_MM, strict=True):
            angle = rng.uniform(0, 2 * np.pi, 12)
            k = 2 * np.pi / length * rng.uniform(0.8, 1.2, 12)
            waves.append(np.stack((k * np.cos(angle), k * np.sin(angle)), axis=1))
            phases.append(rng.uniform(0, 2 * np.pi, 12))
            sizes.append(np.full(12, roughness * sd * np.sqrt(2 / 12)))
        self.k, self.phase, self.size = map(np.concatenate, (waves, phases, sizes))
        groove = rng.uniform(0, np.pi)
        self.groove = np.array((np.cos(groove), np.sin(groove))), rng.uniform(-10, 10)
        self.groove_mm = 0.5 * roughness

    def outer_z(self, xy):
        r2 = (xy**2).sum(axis=-1)
        return self.radius_mm - np.sqrt(self.radius_mm**2 - r2)

    def thickness_z(self, xy):
        waves = (np.sin(xy @ self.k.T + self.phase) * self.size).sum(axis=-1)
        direction, offset = self.groove
        groove = self.groove_mm * np.exp(-(((xy @ direction - offset) / 1.2) ** 2) / 2)
        return np.maximum(self.mean_mm + waves - groove, 1.3)

    def boundaries_z(self, xy):
        outer, tau = self.outer_z(xy)[..., None], self.thickness_z(xy)[..., None]
        return outer + tau * np.array((0.0, 0.29, 0.71, 1.0))

    def layers(self, origins_skull, directions_skull):
        o, u = origins_skull, directions_skull
        s = np.zeros((len(o), 4))
        for _ in range(8):  # fixed point; the slopes are small
            for j in range(4):
                p = o + s[:, j : j + 1] * u
                s[:, j] += (self.boundaries_z(p[:, :2])[:, j] - p[:, 2]) / u[:, 2]
        return s

    def inner_tilt_deg(self, xy, step=1e-4):
        dx = (self.thickness_z(xy + (step, 0)) - self.thickness_z(xy - (step, 0))) / (2 * step)
        dy = (self.thickness_z(xy + (0, step)) - self.thickness_z(xy - (0, step))) / (2 * step)
        return np.rad2deg(np.arctan(np.hypot(dx, dy)))

    def pose(self, xy, *, lift_mm=0.0, tilt_rad=(0.0, 0.0)):
        """Return T_skull_probe standing on the dome, lifted along its axis, tilted a little."""
        x, y = xy
        z = float(self.outer_z(np.array(xy)))
        into = np.array((0.0, 0.0, self.radius_mm)) - (x, y, z)
        into = into / np.linalg.norm(into)
        turn = np.cross((0.0, 0.0, 1.0), into)
        sine = np.linalg.norm(turn)
        rotvec = turn / sine * np.arcsin(sine) if sine > 0 else turn
        upright = Pose.from_rotvec(rotvec, (x, y, z))
        lean = Pose.from_rotvec((*tilt_rad, 0.0))
        return upright @ lean @ Pose.from_translation((0.0, 0.0, -lift_mm))


def scan(skull, settings, *, seed, width_mm=20.0, lines_mm=2.0, tilt_deg=1.0, lift_sd_mm=0.3):
    """Return A-scans along a meander on a skull, their poses, and the true depths (n, 2) in mm.

    Depths are the true distances along the probe axis from its face to the outer boundary, and
    from there to the inner one.
    """
    rng = np.random.default_rng(seed)
    along = np.arange(-width_mm / 2, width_mm / 2 + 1e-9, settings.pitch_mm)
    rows = np.arange(-width_mm / 2, width_mm / 2 + 1e-9, lines_mm)
    path = [(x, y) for i, y in enumerate(rows) for x in (along if i % 2 == 0 else along[::-1])]
    clock, pose = StillClock(), [Pose.identity()]
    probe = VirtualProbe(clock, lambda times: pose[0].repeated(len(times)), skull)
    probe.begin(settings, seed, 0)
    scans, poses, depths = [], [], []
    for i, xy in enumerate(path):
        tilt = np.deg2rad(tilt_deg) * rng.normal(size=2) / np.sqrt(2)
        pose[0] = skull.pose(xy, lift_mm=rng.normal(0.0, lift_sd_mm), tilt_rad=tilt)
        clock.time_s = 0.05 * i
        scans.append(probe.acquire())
        poses.append(pose[0])
        axis = pose[0].rotation[:, 2]
        found = skull.layers((pose[0].translation - 10.0 * axis)[None], axis[None])[0]
        depths.append((found[0] - 10.0, found[3] - found[0]))
    return AScanTrack.from_scans(scans), Poses.stack(poses), np.array(depths)
