"""Echo volume in the scene: two slices, a sheet below the outer boundary, and an iso-surface."""

import numpy as np
from numpy.typing import NDArray

from rona_core.app.steps.maps.volume import echo_volume, volume_surface
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.mapping.volume.echo_volume import EchoVolume, IsoSurface
from rona_ui.presentation.colors import ORANGE, SKY
from rona_ui.presentation.snapshot import Snapshot, changed, shown_volume
from rona_ui.presentation.view_state import VolumeView
from rona_ui.scene.viser_nodes import Layer, SceneNodes

SLICES = ("/volume/u", "/volume/v")
SHEET, OUTER, INNER = "/volume/sheet", "/volume/outer", "/volume/inner"
LEVELS_DB = (-45.0, 0.0)  # black and white, after the gain
FINE = 4  # pixels of a slice for each voxel
SEE_THROUGH = 0.25  # of the outer sheet, so that the inner one is seen
INTO_RIGHT = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))  # columns v, z, u
INTO_BACK = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)))  # columns u, z, -v


class VolumeLayer(Layer):
    """Draws what was asked for of the echo volume, and nothing of it otherwise."""

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._sliced: tuple[EchoVolume, VolumeView] | None = None
        self._surface: IsoSurface | None = None

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw where the session or what is asked for changed."""
        if not changed(old, new, "session", "view"):
            return
        shown = shown_volume(new)
        volume = None if shown is None else _volume(new)
        sliced = surface = None
        if volume is not None and shown is not None and shown.slices:
            sliced = volume, shown
        if volume is not None and shown is not None and shown.surface:
            surface = volume_surface(new.session, shown.level_db, shown.gain_db_per_mm)
        if sliced != self._sliced:
            self._sliced = sliced
            self._draw_slices()
        if surface is not self._surface:
            self._surface = surface
            self._draw_surface(0.0 if volume is None else volume.blind_mm)

    def _draw_slices(self) -> None:
        if self._sliced is None:
            for node in (*SLICES, SHEET):
                self.nodes.remove(node)
            return
        volume, shown = self._sliced
        grey, known = _grey(volume, shown.gain_db_per_mm), volume.known
        u, v, z = volume.outer.u_mm, volume.outer.v_mm, volume.z_mm
        i, j = (int(np.argmin(np.abs(a - at))) for a, at in ((u, shown.u_mm), (v, shown.v_mm)))
        middle = 0.5 * (np.array((u[0], v[0], z[0])) + (u[-1], v[-1], z[-1]))
        sides = np.array([len(a) * (a[1] - a[0]) for a in (u, v, z)])
        places = ((u[i], middle[1], middle[2]), (middle[0], v[j], middle[2]))
        cuts = ((grey[i], known[i]), (grey[:, j], known[:, j]))
        turns, widths = (INTO_RIGHT, INTO_BACK), (sides[1], sides[0])
        for node, cut, turn, place, width in zip(SLICES, cuts, turns, places, widths, strict=True):
            pose = volume.T_base_map @ Pose(turn, np.array(place))
            self.nodes.image(node, slice_picture(*cut), pose, size_mm=(width, sides[2]))
        points, levels = sheet(volume, grey, shown.depth_mm)
        self.nodes.cloud(SHEET, points, np.repeat(levels[:, None], 3, axis=1), size_mm=u[1] - u[0])

    def _draw_surface(self, blind_mm: float) -> None:
        for node in (OUTER, INNER):
            self.nodes.remove(node)
        found = self._surface
        if found is None:
            return
        depths = found.depths_mm[found.faces].mean(axis=1)
        # the lower side of the front echo is no evidence, and would hide what is below it
        for node, which, color, opacity in (
            (OUTER, depths <= 0.0, SKY, SEE_THROUGH),
            (INNER, depths > blind_mm, ORANGE, None),
        ):
            if which.any():
                mesh = Mesh(*_used(found.points_base, found.faces[which]))
                self.nodes.mesh(node, mesh, color, opacity=opacity, side="double")


def _volume(snapshot: Snapshot) -> EchoVolume | None:
    """Return the volume; None where it is refused, which the panel says."""
    try:
        return echo_volume(snapshot.session)
    except RonaError:
        return None


def _used(points: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Return the points that faces use, and the faces with their new numbers."""
    used, numbers = np.unique(faces, return_inverse=True)
    return points[used], numbers.reshape(faces.shape)


def _grey(volume: EchoVolume, gain_db_per_mm: float) -> NDArray[np.uint8]:
    """Return the levels as greys (nu, nv, nz)."""
    low, high = LEVELS_DB
    share = (volume.level_db(gain_db_per_mm) - low) / (high - low)
    return np.round(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def slice_picture(grey: NDArray[np.uint8], known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a slice (n, nz) as a picture (h, w, 4), z upwards; what is not known is clear."""
    picture = np.repeat(grey.T[::-1, :, None], 4, axis=2)
    picture[:, :, 3] = np.where(known.T[::-1], 255, 0)
    return picture.repeat(FINE, axis=0).repeat(FINE, axis=1)


def sheet(
    volume: EchoVolume, grey: NDArray[np.uint8], depth_mm: float
) -> tuple[Floats, NDArray[np.uint8]]:
    """Return the known cells so deep below the outer boundary: places (n, 3) and greys (n,)."""
    heights = volume.outer.height_mm - depth_mm
    k = np.clip(np.rint((heights - volume.z_mm[0]) / volume.steps_mm[2]), 0, len(volume.z_mm) - 1)
    rows = k.astype(np.int64)[:, :, None]
    sure = np.take_along_axis(volume.known, rows, axis=2)[:, :, 0] & volume.outer.ok
    i, j = np.nonzero(sure)
    places = np.column_stack((volume.outer.u_mm[i], volume.outer.v_mm[j], heights[i, j]))
    levels = np.take_along_axis(grey, rows, axis=2)[i, j, 0]
    return volume.T_base_map @ places, levels
