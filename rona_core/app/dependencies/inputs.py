"""What can be an input of a result, and how it is read from a session."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from rona_core.app.dependencies.base_reference import found_again
from rona_core.app.messages.registry import GenerateScanPattern
from rona_core.devices.settings import ROOM_C
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull


@dataclass(frozen=True, slots=True)
class Input:
    """One thing a result is computed from."""

    read: Callable[[Session], Any]  # None or () while it is missing
    wanted: str  # what to do to get it, for the message
    upstream: str | None = None  # the result or capture that may itself be stale
    optional: bool = False  # the result can do without it
    earlier: Callable[[Session], Any] | None = None  # how older files read it


def _value(name: str) -> Callable[[Session], Any]:
    def read(session: Session) -> Any:
        derived = getattr(session.results, name)
        return None if derived is None else derived.value

    return read


def _block_probe(session: Session) -> Any:
    """Return the probe as the block knows it: used elsewhere its line may be warmer."""
    probe = session.setup.devices.probe
    return replace(probe, line_temperature_c=ROOM_C, pitch_mm=1.0)


TOOL_CAPTURE = Input(lambda s: s.captures.tool, "record the tool motion (step 2)", "capture tool")
POINTER_CAPTURE = Input(
    lambda s: s.captures.pointer, "record the pivoting of the pointer (step 3)", "capture pointer"
)
SURFACE_CAPTURE = Input(
    lambda s: s.captures.surface, "slide the pointer over the skull (step 4)", "capture surface"
)
PATH_CAPTURE = Input(
    lambda s: s.captures.path, "demonstrate the scan path (step 5)", "capture path"
)
SECOND_CAPTURE = Input(
    lambda s: s.captures.second, "scan the gaps again (step 9)", "capture second"
)
SCAN_CAPTURE = Input(lambda s: s.captures.scan, "scan (step 8)", "capture scan")
TOOL = Input(_value("tool"), "register the tool (step 2)", "tool")
POINTER = Input(_value("pointer"), "calibrate the pointer (step 3)", "pointer")
SURFACE = Input(_value("surface"), "sample the surface (step 4)", "surface")
PATH = Input(_value("path"), "demonstrate the path (step 5)", "path")
SMOOTHING = Input(_value("smoothing"), "smooth the path (step 6)", "smoothing")
ROLL = Input(_value("roll"), "plan the motion (step 7)", "roll")
PLACEMENT = Input(_value("placement"), "look for a place of the base (step 7)", "placement")
SONO_PIVOT = Input(
    lambda s: s.captures.sono_pivot, "pivot the SonoPointer (step 9)", "capture sono_pivot"
)
SONO_SPIN = Input(
    lambda s: s.captures.sono_spin, "turn the SonoPointer about its axis", "capture sono_spin"
)
SONO_SCAN = Input(lambda s: s.captures.sono_scan, "scan by hand (step 9)", "capture sono_scan")
SONO_CALIBRATION = Input(_value("sono"), "calibrate the SonoPointer (step 9)", "sono")
SONO_DETECTION = Input(_value("sono_detection"), "map the scan by hand", "sono_detection")
ANY_TOOL = Input(_value("tool"), "register the tool (step 2)", "tool", optional=True)
ANY_SURFACE = Input(_value("surface"), "sample the surface (step 4)", "surface", optional=True)
SKULL = Input(lambda s: s.setup.specimen, "load a skull (step 1)")
REGION = Input(lambda s: s.setup.region, "choose a region (step 1)")
RADIUS = Input(lambda s: s.setup.region.radius_mm, "choose a region (step 1)")
DETECTION = Input(_value("detection"), "detect the boundaries (step 9)", "detection")
SECOND = Input(_value("second"), "plan the second pass (step 9)", "second")
ANY_SECOND = Input(lambda s: s.captures.second, "scan the gaps again (step 9)", optional=True)
ANY_SECOND_DETECTION = Input(_value("second_detection"), "detect the boundaries", optional=True)
MAPS = Input(_value("maps"), "compute the maps (step 9)", "maps")
# Of the robot's settings a computation uses its geometry, a plan also the speed. Whether it errs
# and where its base stands count in captures.
MODEL = Input(lambda s: s.setup.devices.robot.model, "choose a robot (step 1)")
SCAN_SPEED = Input(lambda s: s.setup.devices.robot.scan_speed_mm_per_s, "choose a speed (step 1)")
BASE = Input(
    lambda s: (s.setup.devices.robot.base_shift_mm, s.setup.devices.robot.base_turn_deg),
    "choose where the base stands (step 1)",
)
# False where the tracker has moved and may not be found again; it counts for nothing else
_CHOOSE = "choose the reference (step 1)"
SURFACE_REFERENCE = Input(lambda s: found_again(s, s.captures.surface), _CHOOSE)
PATH_REFERENCE = Input(lambda s: found_again(s, (s.captures.path,)), _CHOOSE)
HAND_REFERENCE = Input(lambda s: found_again(s, (s.captures.sono_scan,)), _CHOOSE)
EDITS = Input(lambda s: s.path_edits, "smooth the path (step 6)")
BOUNDARY_EDITS = Input(lambda s: s.boundary_edits.without("hand"), "scan (step 8)")
HAND_EDITS = Input(lambda s: s.boundary_edits.of("hand"), "scan by hand (step 9)")
FIRST_EDITS = Input(lambda s: s.boundary_edits.of("first"), "scan (step 8)")
OUTER_EDITS = Input(lambda s: s.boundary_edits.of("first", "outer"), "scan (step 8)")
REFERENCES = Input(
    lambda s: s.captures.references, "measure reference points (step 9)", "capture references"
)
BLOCK = Input(lambda s: s.captures.block, "take A-scans on the block (step 1)", "capture block")
PROBE = Input(lambda s: s.setup.devices.probe, "choose a probe (step 1)")
BLOCK_PROBE = Input(_block_probe, "choose a probe (step 1)")
HAND_PROBE = Input(  # in the hand it fires by the clock, not by the way
    lambda s: replace(s.setup.devices.probe, pitch_mm=1.0), "choose a probe (step 1)"
)


def missing(inputs: tuple[Input, ...], session: Session) -> str | None:
    """Return what to do first, or None if nothing is missing."""
    for item in inputs:
        if not item.optional and item.read(session) in (None, ()):
            return item.wanted
    return None


def is_pattern(session: Session) -> bool:
    """Return whether the path is a pattern drawn by rule, not a demonstration."""
    path = session.results.path
    return path is not None and path.message == GenerateScanPattern.__name__


def need(value: Any, wanted: str) -> Any:
    """Return ``value``; raise StepBlockedError that says what to do first where it is missing."""
    if value in (None, ()):
        raise StepBlockedError(f"first {wanted}")
    return value


def require_loaded(session: Session) -> LoadedSkull:
    """Return the loaded skull of a session.

    Raises:
        StepBlockedError: a simulated skull lies on the table.
    """
    skull = session.setup.specimen
    if not isinstance(skull, LoadedSkull):
        raise StepBlockedError(
            "the registration of the skull needs a loaded CT, mask or mesh: a simulated skull has "
            "no file to register to; load one in step 1"
        )
    return skull
