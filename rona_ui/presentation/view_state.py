"""View of one browser: step, layers, camera cut, replay, and what is being drawn by mouse."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from rona_core.app.steps.maps.view import MapQuantity
from rona_core.app.steps.roll.view import Quantity
from rona_core.path.zones import PaintKind

Point = tuple[float, float, float]
Pairs = tuple[tuple[Point, Point], ...]  # of points: in the file of a reference, and in base
Drawing = Literal[
    "surface",
    "path",
    "center",
    "boundary",
    "paint_scan",
    "paint_avoid",
    "move",
    "insert",
    "delete",
    "pin",
    "region",
    "implant",
    "pair",
]
# what a click on the skull does: mode -> what the surgeon reads over the scene
MODES: dict[Drawing, str] = {
    "surface": "Drawing a stroke",
    "path": "Drawing the path",
    "center": "Picking the centre",
    "boundary": "Drawing the boundary",
    "paint_scan": "Painting a region to scan",
    "paint_avoid": "Painting a region to avoid",
    "move": "Moving points",
    "insert": "Inserting points",
    "delete": "Deleting points",
    "pin": "Pinning points",
    "region": "Picking the region",
    "implant": "Moving the implant",
    "pair": "Picking a point of the pair",
}
# the changes of the smoothed path, by the words of their buttons
EDITS: dict[str, Drawing] = {"Move": "move", "Insert": "insert", "Delete": "delete", "Pin": "pin"}
PAINTING: dict[str, PaintKind] = {"paint_scan": "scan", "paint_avoid": "avoid"}
CutDirection = Literal["off", "lengthwise", "crosswise"]

# Layers of the scene that can be switched off: name -> what the surgeon reads
LAYERS = {
    "skull": "Skull",
    "head": "Face and sutures",
    "room": "Room",
    "labels": "Labels",
    "robot": "Robot",
    "tracker": "Tracker",
    "sight": "Lines of sight",
    "pointer": "Pointer",
    "region": "Region",
    "cloud": "Surface points",
    "registered_skull": "Registered skull",
    "painted": "Painted regions",
    "path": "Path",
    "arrows": "Probe axes",
    "warnings": "Path warnings",
    "rolls": "Roll candidates",
    "obstacles": "Obstacles",
    "places": "Base poses",
    "landmarks": "Landmarks",
    "scan": "Scan points",
    "outer": "Outer map",
    "inner": "Inner map",
    "fused": "Fused map",
    "second": "Tilted passes",
    "references": "Reference points",
    "implant_outline": "Outline of the implant",
    "implant": "Implant",
    "bed": "Implant bed",
    "milling": "Milling path",
    "bone_left": "Bone while it is milled",
    "chance": "Probability",
}

_ALWAYS = frozenset(("skull", "head", "room", "labels"))
_ROOM = _ALWAYS | {"robot", "tracker", "sight", "pointer", "region", "obstacles"}
# What a step needs to be seen; the rest would be in the way
NEEDED: dict[str, frozenset[str]] = {
    "setup": _ROOM,
    "tool": _ROOM,
    "pointer": _ROOM,
    "surface": _ALWAYS | frozenset(("pointer", "region", "cloud", "registered_skull")),
    "path": _ALWAYS
    | frozenset(("pointer", "region", "cloud", "implant_outline", "path", "painted")),
    "smoothing": _ALWAYS | frozenset(("path", "arrows", "warnings", "painted")),
    "roll": _ALWAYS | frozenset(("robot", "path", "rolls", "obstacles", "places")),
    "scan": _ALWAYS | frozenset(("robot", "path", "scan", "obstacles", "painted", "landmarks")),
    "maps": _ALWAYS
    | frozenset(("region", "pointer", "outer", "inner", "fused", "second", "references")),
    "implant": _ALWAYS | frozenset(("inner", "implant", "bed", "milling", "chance", "bone_left")),
}


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """A bound that is being dragged; it ends when there is another smoothed path."""

    tolerance_mm: float
    smoothing: Any  # the result that was there when it began
    refused: int  # how many messages had been refused


@dataclass(frozen=True, slots=True, eq=False)
class VolumeView:
    """What is drawn of the echo volume; it ends when there are other maps."""

    maps: Any  # the result that was there when it began
    slices: bool = False
    surface: bool = False
    u_mm: float = 0.0  # where a slice goes through the maps, in their frame
    v_mm: float = 0.0
    depth_mm: float = 5.0  # of a sheet below the outer boundary
    level_db: float = -30.0  # of the iso-surface
    gain_db_per_mm: float = 2.0  # with depth: about the loss of skull bone


@dataclass(frozen=True, slots=True)
class ViewState:
    """How one browser looks at the session; never saved, never undone."""

    step: str = "setup"
    open_tabs: frozenset[str] = frozenset()  # of the docks, as far as the page has reported
    skipped: frozenset[str] = frozenset()  # offered stages of the procedure that are passed over
    all_layers: bool = False  # show also what the step does not need
    hidden: frozenset[str] = frozenset(
        {"outer", "fused", "obstacles", "milling", "chance", "labels"}
    )
    shown_roll: int | None = None  # index of the roll in the graphs; None follows the plan
    place: float | None = None  # 0 to 1 along the path, where that roll is looked at; None: where
    # it fails first, or the middle
    margin: Quantity = "room"  # what the path is coloured by in step 7
    cursor: float | None = None  # 0 to 1 along the planned motion; None shows the robot live
    milling_cursor: float | None = None  # the same along the planned milling, in step 10
    playing: bool = False
    speed: float = 4.0  # of the replay, as a multiple of real time
    drawing: Drawing | None = None  # what a click on the skull adds to
    picks: tuple[Point, ...] = ()  # in base, mm
    lifts: tuple[int, ...] = ()  # numbers of the picks before which the pointer is lifted
    moved_point: int | None = None  # number of the point of the smoothed path that is being moved
    move_target: Point | None = None  # where it is held, in base, mm
    held_path: Any | None = None  # the smoothed path that its number counts on
    center: Point | None = None  # of the pattern that is to be made
    boundary: tuple[Point, ...] = ()  # of the same
    brush_mm: float = 5.0  # radius of the brush
    stroke: tuple[Point, ...] = ()  # that is being painted, in base, mm
    preview: Preview | None = None
    quantity: MapQuantity = "thickness"
    skull_window: bool = True  # the drawn skull is open over the region once it has been mapped
    cut_direction: CutDirection = "off"  # plane that the drawn skull is cut with, in every step
    cut_offset_mm: float = 0.0  # from the centre of the region to that plane
    cut_maps: bool = False  # the maps are cut too
    force_across: Literal["path", "time"] = "path"  # what the force is drawn over
    handheld: bool = False  # the scan by hand is looked at, where there are both
    handheld_cursor: float = 0.0  # 0 to 1 along the scan by hand
    joint: int = 0  # joint in the graph, 0 for all
    comparison: str | None = None  # job that compared the maps with a reference
    pairs: Pairs = ()  # that a reference is laid by
    bone_threshold: float = 300.0  # from which a value of a reference CT is bone
    compared_pairs: Pairs = ()  # those that the comparison had
    pair_place: Point | None = None  # in base, the place pointed at for the next pair
    volume: VolumeView | None = None  # None: nothing is drawn of it
    second: bool = False  # replay, A-scans and image are those of the second pass
    dragged_boundary: tuple[int, float] | None = (
        None  # A-scan and time (µs) at which a boundary is being dragged
    )

    @property
    def replay_cursor(self) -> float | None:
        """Return where the replay of the step is, 0 to 1; None shows the robot live."""
        return self.milling_cursor if self.step == "implant" else self.cursor

    def replayed_at(self, cursor: float | None, *, playing: bool = False) -> "ViewState":
        """Return the view with the replay of its step elsewhere."""
        if self.step == "implant":
            return replace(self, milling_cursor=cursor, playing=playing)
        return replace(self, cursor=cursor, playing=playing)

    def shows(self, layer: str) -> bool:
        """Return whether a layer of the scene is to be seen."""
        return layer not in self.hidden and (self.all_layers or layer in NEEDED[self.step])
