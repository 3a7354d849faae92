"""What the devices show for the eye: the drawn skull, and where things stand."""

from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class DrawnHead:
    """A head for the eye: the true calvaria, and beneath it a face that is no person's."""

    calvaria: Mesh  # the part of the outer surface above brow, ear canal and inion
    face: Mesh  # from a template
    shades: Floats  # (n,) 0 to 1: how much light reaches each vertex of the face
    sutures: Floats  # (k, 2, 3) segments on the calvaria


class Display(Protocol):
    """What is drawn for the eye, never an input of an algorithm."""

    def skull_mesh_base(self) -> Mesh:
        """Return the outer surface of the specimen in ``base``."""
        ...

    def drawn_head_base(self) -> DrawnHead | None:
        """Return the head in ``base``; None where the surface of the specimen shows its own."""
        ...

    def pick(self, origin_base: ArrayLike, direction_base: ArrayLike) -> Vector3 | None:
        """Return where a ray of sight meets the drawn skull (3,), or None if it misses."""
        ...

    def point_mesh(self, point_base: ArrayLike) -> Vector3:
        """Return a place of ``base`` (3,) in ``mesh``, in which the region is chosen."""
        ...

    def region(self) -> tuple[Vector3, Vector3, float]:
        """Return centre (3,), outward normal (3,) in ``base`` and radius in mm of the region."""
        ...

    def head_axes_base(self) -> Floats | None:
        """Return right, front and top of the head as unit columns (3, 3) in ``base``.

        None where the source of the skull does not say which way is which.
        """
        ...

    def T_base_tracker(self) -> Pose:  # noqa: N802 (frame grammar)
        """Return where the tracker stands, to draw it and its volume."""
        ...

    def T_base_basemarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the marker on the robot base is, to draw it; None if there is none."""
        ...

    def T_base_pointermarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the pointer is now, to draw it; None while it lies aside."""
        ...
