"""What activities produce. Internal: no route leads here, so nobody can post a forged result."""

from dataclasses import dataclass

from rona_core.mapping.boundary_map import Maps
from rona_core.robot.base_placement.candidates import BasePlacement
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.document import (
    BlockCapture,
    PointerCapture,
    ReferenceCapture,
    ScanCapture,
    SecondPass,
    SonoCapture,
    SonoMaps,
    ToolCapture,
)
from rona_core.session.specimen import LoadedSkull
from rona_core.surface.icp import SurfaceRegistration
from rona_core.ultrasound.acoustic_calibration.parameter_sweep import WhatIf
from rona_core.ultrasound.detection.detect import Detection


@dataclass(frozen=True, slots=True, eq=False)
class StoreSkull:
    """A skull was read from a file."""

    skull: LoadedSkull


@dataclass(frozen=True, slots=True, eq=False)
class StoreToolCapture:
    """The tool motion was recorded."""

    capture: ToolCapture


@dataclass(frozen=True, slots=True, eq=False)
class StorePointerCapture:
    """The pivoting of the pointer was recorded."""

    capture: PointerCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreSurfaceCapture:
    """A stroke over the surface was recorded; it replaces the earlier ones or adds to them."""

    capture: PointerCapture
    append: bool


@dataclass(frozen=True, slots=True, eq=False)
class StorePathCapture:
    """A demonstrated path was recorded."""

    capture: PointerCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreRobotPlan:
    """The roll search ended, with or without a plan."""

    plan: RobotPlan
    arguments: dict[str, object]
    inputs: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class StoreBasePlacement:
    """The search for a place of the base ended."""

    placement: BasePlacement
    arguments: dict[str, object]
    inputs: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class StoreRegistration:
    """The surface points were laid onto the loaded skull."""

    registration: SurfaceRegistration
    arguments: dict[str, object]
    inputs: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class StoreScanCapture:
    """A scan was recorded."""

    capture: ScanCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreSecondPlan:
    """The second pass was planned."""

    second: SecondPass
    arguments: dict[str, object]
    inputs: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class StoreSecondCapture:
    """The gaps were scanned again."""

    capture: ScanCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreMaps:
    """Boundaries were detected and mapped."""

    detection: Detection
    second_detection: Detection | None  # None: there was no second pass
    maps: Maps
    arguments: dict[str, object]
    inputs: dict[str, dict[str, str]]  # result -> digests of what it was computed from


@dataclass(frozen=True, slots=True, eq=False)
class StoreReferences:
    """Thicknesses were measured with a caliper; they replace the earlier ones or add to them."""

    capture: ReferenceCapture
    append: bool


@dataclass(frozen=True, slots=True, eq=False)
class StoreBlockCapture:
    """A-scans were taken on a block."""

    capture: BlockCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreWhatIf:
    """Other probes were tried on virtual plates."""

    what_if: WhatIf
    arguments: dict[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class StoreSonoPivot:
    """The pivoting of the probe in the hand was recorded."""

    capture: PointerCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreSonoSpin:
    """The probe in the hand was turned about its own axis."""

    capture: PointerCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreSonoScan:
    """A scan by hand was recorded."""

    capture: SonoCapture


@dataclass(frozen=True, slots=True, eq=False)
class StoreSonoMaps:
    """Boundaries were detected in a scan by hand, and mapped."""

    sono_detection: Detection
    sono_maps: SonoMaps
    arguments: dict[str, object]
    inputs: dict[str, dict[str, str]]  # result -> digests of what it was computed from
