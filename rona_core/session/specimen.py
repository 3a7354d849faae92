"""What is scanned, as a session stores it: a simulated skull, or a skull cut out of a file.

Coordinates are those of the specimen (``skull``): for a file, the coordinates of that file.
"""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.limits import choice, require_limits, switch
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, readonly

Side = Literal["left", "right"]
BoneKind = Literal["normal", "sharp", "hard"]
SkullKind = Literal["mask", "ct", "mesh"]


@dataclass(frozen=True, slots=True)
class SimulatedSkull:
    """A skull made from the seed of the session; ``side`` says which side is scanned."""

    __pydantic_config__: ClassVar = {"extra": "forbid", "allow_inf_nan": False}

    side: Side = choice(
        "left", "Skull", {"left": "Simulated, left side", "right": "Simulated, right side"}
    )

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class BoneChoice:
    """What the bone of the specimen is made of, as its shape does not say; for its echoes alone.

    ``kind``: normal; sharp, where the diploe begins at once and echoes louder than the inner
    boundary; or hard, with 2.5 times the scatter on top, and rougher. ``own_speed``: the patient's
    speed of sound differs from the nominal one, as it does between people (3 %) and from place to
    place (2 %).
    """

    __pydantic_config__: ClassVar = {"extra": "forbid", "allow_inf_nan": False}

    kind: BoneKind = choice(
        "normal",
        "Bone",
        {"normal": "Normal", "sharp": "Sharp diploe", "hard": "Hard: sharp, more scatter"},
        "Known only to the virtual probe",
    )
    own_speed: bool = switch(
        True, "Patient-specific speed", "Sound speed of bone differs by 3 % between patients"
    )

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True, eq=False)
class LoadedSkull:
    """A skull from a file: the signed distance to its bone, fixed once, around the scanned disc.

    Node (i, j, k) of ``distance_um`` lies at
    ``origin_skull + spacing_mm * axes_skull @ (i, j, k)``.
    The distance is negative in bone, in micrometres, clipped to a band about the surface.
    """

    name: str
    kind: SkullKind
    sha256: tuple[str, ...]  # of the source file, and of the inner file where there were two
    threshold: float | None  # grey value that separates bone, for a CT
    smoothing_mm: float  # sigma of the Gaussian that smoothed the distance; 0 for a mesh
    distance_um: NDArray[np.int16]  # (nx, ny, nz)
    spacing_mm: float
    origin_skull: Vector3  # node (0, 0, 0)
    axes_skull: Floats  # (3, 3), columns are the unit axes of the grid; the third points outward
    mesh_vertices_skull: NDArray[np.float32]  # (n, 3) the whole skull, coarse, for the eye
    mesh_faces: NDArray[np.int32]  # (m, 3)
    center_skull: Vector3  # centre of the scanned disc, on the outer surface
    normal_skull: Vector3  # outward
    radius_mm: float
    mean_thickness_mm: float  # along the inward normals over the disc
    # value of bone in a map of labels; sessions of before have none
    label: int | None = field(default=None, metadata={"omit_empty": True})

    def __post_init__(self) -> None:
        if self.distance_um.ndim != 3 or min(self.distance_um.shape) < 8:
            raise InvalidInputError(
                f"the distance of a loaded skull must be a volume of at least 8 nodes a side, "
                f"not {self.distance_um.shape}"
            )
        if self.axes_skull.shape != (3, 3) or not self.spacing_mm > 0 or not self.radius_mm > 0:
            raise InvalidInputError(
                "a loaded skull needs three axes, a spacing and a radius above 0"
            )
        for name in (
            "distance_um",
            "origin_skull",
            "axes_skull",
            "mesh_vertices_skull",
            "mesh_faces",
            "center_skull",
            "normal_skull",
        ):
            object.__setattr__(self, name, readonly(getattr(self, name)))
