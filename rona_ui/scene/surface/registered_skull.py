"""A loaded skull where its registration puts it: contour lines, beside the skull as it is drawn."""

import numpy as np

from rona_core.devices.protocols import Mesh
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull
from rona_ui.presentation.colors import GREEN
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.cut_plane import Plane, crossings
from rona_ui.scene.layer import Layer

NODE = "/registered_skull"
APART_MM = 12.0  # from contour to contour
LIFT_MM = 0.4  # off the mesh, so that the lines are to be seen where both skulls agree


class RegisteredSkullLayer(Layer):
    """Draws the contours of the registered skull."""

    layer = "registered_skull"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw them where registration or skull have changed."""
        if (
            old is None
            or old.session.results.registration is not new.session.results.registration
            or old.session.setup.specimen is not new.session.setup.specimen
        ):
            self.nodes.lines(NODE, contours(new.session), GREEN, width_px=1.5)
        if NODE in self.nodes.names():
            self.nodes.show(NODE, self.shown(new))


def contours(session: Session) -> Floats:
    """Return segments (n, 2, 3) in ``base`` round the registered skull; none without one."""
    registered, skull = session.results.registration, session.setup.specimen
    if registered is None or not isinstance(skull, LoadedSkull):
        return np.zeros((0, 2, 3))
    vertices = np.asarray(skull.mesh_vertices_skull, dtype=np.float64)
    faces = np.asarray(skull.mesh_faces, dtype=np.int64)
    mesh = Mesh(vertices + LIFT_MM * _normals(vertices, faces), faces)
    lines: list[Floats] = []
    for axis in np.eye(3)[:2]:
        heights = mesh.vertices @ axis
        for height in np.arange(heights.min() + APART_MM / 2.0, heights.max(), APART_MM):
            lines.append(crossings(mesh, Plane(height * axis, axis)).rim_base(mesh.vertices))
    T_base_skull = registered.value.T_b_a.inv()
    return (T_base_skull @ np.concatenate(lines).reshape(-1, 3)).reshape(-1, 2, 3)


def _normals(vertices: Floats, faces: np.ndarray) -> Floats:
    """Return unit normals (n, 3) of the vertices, outward where the faces are."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, faces[:, corner], across)
    return sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-12)[:, None]
