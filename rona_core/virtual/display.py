"""Meshes and picking of the virtual scene, for the viewer only."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.protocols import Mesh
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_vector3
from rona_core.geometry.pose import Pose
from rona_core.virtual.scene import VirtualScene

EDGE_MM = 3.0  # of the triangles that the skull is drawn with


class VirtualDisplay:
    """Shows the scene; satisfies ``devices.Display``."""

    def __init__(self, scene: VirtualScene, pointer: Callable[[], Pose | None]) -> None:
        """Draw ``scene``; ``pointer()`` returns where the pointer is now."""
        self._scene = scene
        self._pointer = pointer

    def begin(self, scene: VirtualScene) -> None:
        """Draw this scene from now on."""
        self._scene = scene

    def skull_mesh_base(self) -> Mesh:
        """Return the outer surface of the specimen in ``base``."""
        mesh = self._scene.specimen.mesh(EDGE_MM)
        return Mesh(self._scene.T_base_skull @ mesh.vertices, mesh.faces)

    def pick(self, origin_base: ArrayLike, direction_base: ArrayLike) -> Vector3 | None:
        """Return where a ray of sight meets the skull (3,) in ``base``, or None if it misses.

        Raises:
            InvalidInputError: the direction has no length.
        """
        origin = as_vector3(origin_base, name="origin_base")
        direction = as_vector3(direction_base, name="direction_base")
        length = np.linalg.norm(direction)
        if length <= 0.0:
            raise InvalidInputError("direction_base must not be (0, 0, 0)")
        direction = direction / length
        T_skull_base = self._scene.T_base_skull.inv()
        rays = (T_skull_base @ origin)[None], T_skull_base.rotate(direction)[None]
        distance_mm = float(self._scene.specimen.ray(*rays)[0])
        return origin + distance_mm * direction if np.isfinite(distance_mm) else None

    def region(self) -> tuple[Vector3, Vector3, float]:
        """Return centre (3,), outward normal (3,) in ``base`` and radius in mm of the region."""
        return self._scene.region_base()

    def head_axes_base(self) -> Floats | None:
        """Return right, front and top of the head as unit columns (3, 3), or None."""
        axes_skull = self._scene.specimen.head_axes_skull
        if axes_skull is None:
            return None
        return self._scene.T_base_skull.rotate(axes_skull.T).T

    def T_base_tracker(self) -> Pose:  # noqa: N802 (frame grammar)
        """Return where the tracker stands."""
        return self._scene.T_base_tracker

    def T_base_basemarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the marker on the robot base is."""
        return self._scene.T_base_basemarker

    def T_base_pointermarker(self) -> Pose | None:  # noqa: N802 (frame grammar)
        """Return where the pointer is now; None while it lies aside."""
        return self._pointer()
