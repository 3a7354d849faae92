"""A milling path: its places and purposes, its feeds, its motion and its files."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Floats, Ints, as_floats, as_points, as_unit_vectors, readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.files.map_mesh import MapMesh, closable_triangles, rim_edges
from rona_core.mapping.files.mesh_files import stl_bytes
from rona_core.planning.bed import Bed
from rona_core.planning.milling.burr import Burr


class Move(IntEnum):
    """What a move is for."""

    RETRACT = 0  # up, over and down again in the air
    ENTRY = 1  # down along a ramp into a layer
    CUT = 2
    RIM = 3  # with the smaller burr along the rim


@dataclass(frozen=True, slots=True, eq=False)
class MillingPath:
    """Tip of the tool and its axis, which points into the bone, at each place (n) in ``bed``.

    Entry k of ``moves``, ``layers`` and ``tools`` belongs to the move that ends at place k.
    """

    tips_bed: Floats  # (n, 3) where the burr meets its own axis
    axes_bed: Floats  # (n, 3)
    moves: Ints  # (n,) of ``Move``
    layers: Ints  # (n,) counted from the top; those of the rim pass go on after the others
    tools: Ints  # (n,) which of the burrs
    burrs: tuple[Burr, ...]

    def __post_init__(self) -> None:
        tips = as_points(self.tips_bed, at_least=1, name="tips_bed")
        axes = as_unit_vectors(self.axes_bed, name="axes_bed")
        sizes = {len(a) for a in (tips, axes, self.moves, self.layers, self.tools)}
        require(len(sizes) == 1, f"all arrays of a path must be as long, not {sorted(sizes)}")
        require(bool((np.diff(self.layers) >= 0).all()), "layers of a path must not go back")
        require(bool((axes[:, 2] < 0.0).all()), "axes of a path must point into the bone")
        object.__setattr__(self, "tips_bed", readonly(tips))
        object.__setattr__(self, "axes_bed", readonly(axes))
        for name in ("moves", "layers", "tools"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.tips_bed)

    def bottoms_bed(self) -> Floats:
        """Return the lowest place of the burr (n, 3); of a ball that is tilted it is not its tip.

        Only balls are tilted.
        """
        radii = np.array([burr.radius_mm for burr in self.burrs])[self.tools][:, None]
        return self.tips_bed - radii * (self.axes_bed + (0.0, 0.0, 1.0))

    def part(self, first: int, end: int) -> "MillingPath":
        """Return the places from the first one up to, without, the end; at least one."""
        kept = slice(first, end)
        return MillingPath(
            self.tips_bed[kept],
            self.axes_bed[kept],
            self.moves[kept],
            self.layers[kept],
            self.tools[kept],
            self.burrs,
        )

    def followed_by(self, other: "MillingPath") -> "MillingPath":
        """Return this path and then another one with the same burrs."""
        return MillingPath(
            np.concatenate((self.tips_bed, other.tips_bed)),
            np.concatenate((self.axes_bed, other.axes_bed)),
            np.concatenate((self.moves, other.moves)),
            np.concatenate((self.layers, other.layers)),
            np.concatenate((self.tools, other.tools)),
            self.burrs,
        )

    def length_mm(self, *moves: Move) -> float:
        """Return the way of the tip in moves of some kinds; without any, of all."""
        steps = np.linalg.norm(np.diff(self.tips_bed, axis=0), axis=1)
        kept = np.isin(self.moves[1:], moves or tuple(Move))
        return float(steps[kept].sum())


# all assumed
FULL_MM_PER_S, THIN_MM_PER_S = 4.0, 1.0  # feed where the bone is thick, and where it is thin
THIN_MM, THICK_MM = 1.0, 3.0  # residual bone; between them the feed is interpolated
AIR_MM_PER_S = 20.0  # of moves in the air


def feeds_mm_per_s(path: MillingPath, residual_mm: Floats) -> Floats:
    """Return the feed (n,) of each move: that of the thinner of its two ends.

    Dillon 2016 plans the speed from the bone in the same way.

    Args:
        path: Of n places.
        residual_mm: Bone left below each place (n,), as the maps say.

    Raises:
        InvalidInputError: not as many residuals as places, or values that are not finite.
    """
    residual = as_floats(residual_mm, name="residual_mm")
    require(
        residual.shape == (len(path),),
        f"residual_mm must have shape ({len(path)},), one for each place, not {residual.shape}",
    )
    thinner = np.minimum(residual, np.concatenate((residual[:1], residual[:-1])))
    feeds = np.interp(thinner, (THIN_MM, THICK_MM), (THIN_MM_PER_S, FULL_MM_PER_S))
    return readonly(np.where(path.moves == Move.RETRACT, AIR_MM_PER_S, feeds))


def duration_s(path: MillingPath, feeds: Floats) -> float:
    """Return how long a path lasts at the feeds (n,) of its moves, in mm/s."""
    steps = np.linalg.norm(np.diff(path.tips_bed, axis=0), axis=1)
    return float((steps / feeds[1:]).sum())


@dataclass(frozen=True, slots=True, eq=False)
class MillingMotion:
    """Where the burr is at n times; between them its tip goes straight and its axis evenly."""

    times_s: Floats  # (n,) from the start of the motion
    tips_base: Floats  # (n, 3) where the burr meets its own axis
    axes_base: Floats  # (n, 3) into the bone
    places: Ints  # (n,) place of the milling path at which the move under way ends


COLUMNS = "x_mm,y_mm,z_mm,axis_x,axis_y,axis_z,feed_mm_per_s,move,layer,burr_diameter_mm"
RAPID = int(Move.RETRACT)


def path_csv(path: MillingPath, feeds_mm_per_s: Floats) -> str:
    """Return the path as a table: tip and axis (into the bone) in ``bed``, one row for each place.

    Raises:
        InvalidInputError: not as many feeds as places.
    """
    _require_feeds(path, feeds_mm_per_s)
    rows = [COLUMNS]
    for k in range(len(path)):
        numbers = (*path.tips_bed[k], *path.axes_bed[k], feeds_mm_per_s[k])
        move = Move(int(path.moves[k])).name.lower()
        diameter_mm = path.burrs[int(path.tools[k])].diameter_mm
        values = ",".join(f"{value:.6g}" for value in numbers)
        rows.append(f"{values},{move},{path.layers[k]},{diameter_mm:g}")
    return "\n".join(rows) + "\n"


def path_gcode(path: MillingPath, feeds_mm_per_s: Floats) -> str:
    """Return the path as G-code in mm and mm/min, its zero at the origin of ``bed``.

    X, Y and Z are the tip of the tool. Where a burr is tilted, A and B turn it about x and then
    about y by degrees, out of upright.

    Raises:
        InvalidInputError: not as many feeds as places.
    """
    _require_feeds(path, feeds_mm_per_s)
    axes = path.axes_bed
    a_deg = np.rad2deg(np.arctan2(axes[:, 1], np.hypot(axes[:, 0], axes[:, 2])))
    b_deg = np.rad2deg(np.arctan2(-axes[:, 0], -axes[:, 2]))
    tilted = bool((np.abs(axes[:, :2]) > 1e-9).any())
    lines = ["(bed of an implant, frame bed, z out of the bone)", "G21", "G90", "G94"]
    tool = -1
    for k in range(len(path)):
        if int(path.tools[k]) != tool:
            tool = int(path.tools[k])
            burr = path.burrs[tool]
            lines.append(
                f"(burr of {burr.diameter_mm:g} mm, corner radius {burr.corner_radius_mm:g} mm)"
            )
            lines.append(f"T{tool + 1} M6")
        x, y, z = path.tips_bed[k]
        word = "G0" if path.moves[k] == RAPID else "G1"
        line = f"{word} X{x:.4f} Y{y:.4f} Z{z:.4f}"
        if tilted:
            line += f" A{a_deg[k]:.4f} B{b_deg[k]:.4f}"
        lines.append(line if word == "G0" else f"{line} F{60.0 * feeds_mm_per_s[k]:.1f}")
    return "\n".join((*lines, "M30", ""))


def bed_stl(bed: Bed, T_base_bed: Pose) -> bytes:
    """Return the closed body that a bed takes out of the bone below z = 0 as STL, in ``base``.

    Raises:
        DegenerateGeometryError: the bed has no three neighbouring cells.
    """
    return stl_bytes(bed_mesh(bed, T_base_bed))


def bed_mesh(bed: Bed, T_base_bed: Pose) -> MapMesh:
    """Return the closed mesh of what a bed takes out of the bone below z = 0, in ``base``.

    Raises:
        DegenerateGeometryError: the bed has no three neighbouring cells.
    """
    triangles = closable_triangles(bed.cut())
    used, rows = np.unique(triangles, return_inverse=True)
    top = rows.reshape(triangles.shape)
    n = len(used)
    x, y = np.meshgrid(bed.x_mm, bed.y_mm, indexing="ij")
    flat = np.column_stack((x.ravel(), y.ravel()))[used]
    depth = bed.depth_mm.ravel()[used]
    points_bed = np.vstack((np.column_stack((flat, np.zeros(n))), np.column_stack((flat, -depth))))
    rim = rim_edges(top)
    a, b = rim[:, 0], rim[:, 1]
    walls = np.vstack((np.column_stack((b, a, a + n)), np.column_stack((b, a + n, b + n))))
    return MapMesh(T_base_bed @ points_bed, np.vstack((top, top[:, ::-1] + n, walls)), {})


def _require_feeds(path: MillingPath, feeds_mm_per_s: Floats) -> None:
    require(
        feeds_mm_per_s.shape == (len(path),),
        f"feeds_mm_per_s must have shape ({len(path)},), not {feeds_mm_per_s.shape}",
    )
