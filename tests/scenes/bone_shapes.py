"""Bone between two smooth surfaces, for A-scans with a known answer. Frame ``skull``, z inward."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses

WAVES = 12  # that make up the relief of the inner table
FIXED_POINT_ROUNDS = 8  # slopes are small, each round gains more than an order of magnitude


@dataclass(frozen=True, slots=True, eq=False)
class Dome:
    """A plate or dome of bone: outer face through the origin, thickness a field over (x, y)."""

    thickness_mm: float
    radius_mm: float = np.inf  # of the outer face; infinite: flat
    slopes: tuple[float, float] = (0.0, 0.0)  # of the thickness along x and y
    shares: tuple[float, float] = (0.29, 0.71)  # where diploe begins and ends
    waves_per_mm: Floats | None = None  # (w, 2) of the relief; None: smooth
    phases_rad: Floats | None = None  # (w,)
    heights_mm: Floats | None = None  # (w,)

    def with_relief(
        self, random: np.random.Generator, tilt_rms_rad: float, length_mm: float
    ) -> "Dome":
        """Return this bone with an inner table of such tilt against the outer one (rms)."""
        angle = random.uniform(0.0, 2.0 * np.pi, WAVES)
        k = 2.0 * np.pi / length_mm * random.uniform(0.7, 1.3, WAVES)
        height = tilt_rms_rad / (2.0 * np.pi / length_mm) * np.sqrt(2.0 / WAVES)
        return Dome(
            self.thickness_mm,
            self.radius_mm,
            self.slopes,
            self.shares,
            np.stack((k * np.cos(angle), k * np.sin(angle)), axis=1),
            random.uniform(0.0, 2.0 * np.pi, WAVES),
            np.full(WAVES, height),
        )

    def outer_z(self, xy: Floats) -> Floats:
        """Return the height (...,) of the outer face at places (..., 2)."""
        r2 = np.sum(xy**2, axis=-1)
        bend = 1.0 / self.radius_mm
        return bend * r2 / (1.0 + np.sqrt(1.0 - bend**2 * r2))

    def thickness_z(self, xy: Floats) -> Floats:
        """Return the thickness (...,) along z at places (..., 2)."""
        thickness = self.thickness_mm + xy @ np.array(self.slopes)
        if self.waves_per_mm is None or self.phases_rad is None or self.heights_mm is None:
            return thickness
        relief = np.sin(xy @ self.waves_per_mm.T + self.phases_rad) @ self.heights_mm
        return np.maximum(thickness + relief, 0.8)

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return distances (n, 4) along rays to the four boundaries."""
        o, u = origins_skull, directions_skull
        depth = np.array((0.0, *self.shares, 1.0))
        s = np.zeros((len(o), 4))
        for _ in range(FIXED_POINT_ROUNDS):
            p = o[:, None, :] + s[:, :, None] * u[:, None, :]
            boundary = self.outer_z(p[..., :2]) + self.thickness_z(p[..., :2]) * depth
            s = s + (boundary - p[..., 2]) / u[:, None, 2]
        return s

    def pose(self, xy: tuple[float, float], lift_mm: float, lean_rad: tuple[float, float]) -> Pose:
        """Return ``T_skull_probe``, on the outer face at (x, y), lifted, and leaning a little."""
        x, y = xy
        z = float(self.outer_z(np.array(xy)))
        into = np.array((-x, -y, self.radius_mm - z)) if np.isfinite(self.radius_mm) else None
        turn = np.zeros(3)
        if into is not None and (x or y):
            into = into / np.linalg.norm(into)
            turn = np.cross((0.0, 0.0, 1.0), into)
            sine = float(np.linalg.norm(turn))
            turn = turn / sine * np.arcsin(sine)
        upright = Pose.from_rotvec(turn, (x, y, z))
        lean = Pose.from_rotvec((*lean_rad, 0.0))
        return upright @ lean @ Pose.from_translation((0.0, 0.0, -lift_mm))


def leans_rad(random: np.random.Generator, n: int, least_deg: float, most_deg: float) -> Floats:
    """Return turns (n, 2) about x and y, their size even between two bounds."""
    size = np.deg2rad(random.uniform(least_deg, most_deg, n))
    angle = random.uniform(0.0, 2.0 * np.pi, n)
    return np.stack((size * np.cos(angle), size * np.sin(angle)), axis=1)


def grid_places(side: int, pitch_mm: float) -> tuple[Floats, np.typing.NDArray[np.int64]]:
    """Return places (n, 2) of a square meander about the origin, and row and column (n, 2)."""
    order = [
        (row, column if row % 2 == 0 else side - 1 - column)
        for row in range(side)
        for column in range(side)
    ]
    cells = np.array(order, dtype=np.int64)
    middle = (side - 1) / 2.0
    return np.asarray((cells[:, ::-1] - middle) * pitch_mm, dtype=np.float64), cells


def angles_deg(a: Floats, b: Floats) -> Floats:
    """Return the angle (n,) between unit vectors (n, 3)."""
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    return np.rad2deg(np.arctan2(cross, np.sum(a * b, axis=1)))


def axes_of(Ts_skull_probe: Poses) -> Floats:
    """Return the axes (n, 3) of a probe at its poses, into the bone."""
    return Ts_skull_probe.rotations[:, :, 2]
