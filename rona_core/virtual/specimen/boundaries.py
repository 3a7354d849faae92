"""Interface of a specimen: its four boundaries in the frame ``skull``, in millimetres."""

from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from rona_core.devices.protocols import DrawnHead
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_points, as_unit_vectors
from rona_core.geometry.mesh import Mesh

RADII_MM = (5.0, 60.0)  # smallest and largest region


@dataclass(frozen=True, slots=True)
class Relief:
    """RMS unevenness of boundaries on top of their smooth shape, and its correlation length."""

    outer_mm: float = 0.0  # of the outer boundary of a simulated skull
    inner_mm: float = 0.0  # of the inner boundary of a simulated skull
    step_mm: float = 0.0  # of the step from outer table to diploe
    length_mm: float = 5.0  # of inner boundary and step: correlation exp(-d^2 / 2 L^2)


SMOOTH = Relief()


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The disc that is scanned."""

    center_skull: Vector3  # (3,), on the outer surface
    normal_skull: Vector3  # (3,), outward, the mean over the middle of the disc
    radius_mm: float


class Specimen(Protocol):
    """The bone under the probe. All points and directions are in ``skull``; directions are unit."""

    region: Region

    @property
    def head_axes_skull(self) -> Floats | None:
        """Right, front and top of the head as unit columns (3, 3); None where unknown."""
        ...

    def ray(self, origins_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the distance in mm (n,) along each ray to the outer boundary.

        Args:
            origins_skull: (n, 3), outside the head.
            directions_skull: (n, 3), unit length.

        Returns:
            Distance to the first place where the ray is inside the bone: inf where it misses, 0
            where it starts inside.
        """
        ...

    def layers(self, origins_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the distances (n, 4) in mm of the four boundaries along each ray, outermost first.

        They never decrease; inf where a boundary is missing.
        """
        ...

    def thickness(self, points_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the bone (n,) in mm from outer surface points along inward directions.

        The scored truth is the thickness along the inward true normal of the outer surface.
        """
        ...

    def closest(self, points_skull: ArrayLike) -> Floats:
        """Return the nearest point (n, 3) of the outer boundary to each point near it."""
        ...

    def normal(self, points_skull: ArrayLike) -> Floats:
        """Return the outward unit normals (n, 3) of the outer boundary at points on or near it."""
        ...

    def mesh(self, edge_mm: float = 3.0) -> Mesh:
        """Return triangles of the outer boundary for the eye; never an input of an algorithm."""
        ...

    def drawn_head(self, edge_mm: float = 3.0) -> DrawnHead | None:
        """Return a head for the eye; None where ``mesh`` is all there is to see."""
        ...


def as_rays(origins_skull: ArrayLike, directions_skull: ArrayLike) -> tuple[Floats, Floats]:
    """Return origins (n, 3) and unit directions (n, 3) of rays.

    Raises:
        InvalidInputError: not as many directions as origins, or not of unit length.
    """
    o = as_points(origins_skull, name="origins_skull")
    d = as_unit_vectors(directions_skull, name="directions_skull")
    if len(o) != len(d):
        raise InvalidInputError(f"{len(o)} origins need as many directions, not {len(d)}")
    return o, d
