"""Triangle mesh."""

from dataclasses import dataclass

from rona_core.geometry.arrays import Floats, Ints


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh: vertices (n, 3) in mm, faces (m, 3)."""

    vertices: Floats
    faces: Ints
