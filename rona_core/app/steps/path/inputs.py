"""Inputs of the scan path, and what others take from it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.references import (
    REGISTERED,
    HeadReference,
    Registered,
    found_again,
    head_input,
    head_of,
)
from rona_core.app.dependencies.staleness import capture_input, result_input, stale_reason
from rona_core.app.steps.path.messages import GenerateScanPattern
from rona_core.app.steps.path.painting import PAINTED
from rona_core.app.steps.pointer.inputs import POINTER
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE, RADIUS
from rona_core.app.steps.surface.inputs import SURFACE, SURFACE_CAPTURE, Strokes
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.geometry.arrays import Vector3
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.path.zones import PaintedRegions
from rona_core.session.captures import PointerCapture
from rona_core.session.document import RawPath, Session, SmoothPath

PATH_CAPTURE: Input[PointerCapture] = capture_input("path")
PATH: Input[RawPath] = result_input("path")
SMOOTHING: Input[SmoothPath] = result_input("smoothing")
REFERENCE = Input(lambda s: found_again(s, (s.captures.path,)), CHOOSE_REFERENCE)


def is_pattern(session: Session) -> bool:
    """Return whether the path is a pattern drawn by rule, not a demonstration."""
    path = session.results.path
    return path is not None and path.message == GenerateScanPattern.__name__


DEMONSTRATED: Input[PointerCapture] = Input(
    lambda s: None if is_pattern(s) else s.captures.path, "demonstrate the path", optional=True
)


def viewpoint(registered: Registered, strokes: Sequence[PointerCapture]) -> Vector3:
    """Return where the pointer's markers were in strokes: the side the probe comes from."""
    seen = [
        registered.reference(stroke).T_base_tracker @ stroke.marker.Ts_tracker_marker.translations
        for stroke in strokes
    ]
    return np.vstack(seen).mean(axis=0)


def _viewpoint_of_path(
    registered: Registered, demonstrated: PointerCapture | None, strokes: Strokes
) -> Vector3:
    return viewpoint(registered, strokes if demonstrated is None else (demonstrated,))


VIEWPOINT: Quantity[Vector3] = Quantity(
    _viewpoint_of_path,
    {"registered": REGISTERED, "demonstration": DEMONSTRATED, "strokes": SURFACE_CAPTURE},
)


def _usable_head(session: Session) -> HeadReference | None:
    """Return how the head lay in step 4; None where its strokes are of another set-up."""
    return None if stale_reason("capture surface", session) else head_of(session)


HEAD: Input[HeadReference] = replace(head_input("path"), read=_usable_head)
OF_REGISTRATION = ("place of the tracker", "field of the tracker")


@inputs(implied=OF_REGISTRATION, free=("use of the base marker",))
class PathInputs:
    """What a demonstrated path is mapped from."""

    stroke: PointerCapture = given(PATH_CAPTURE, "capture")
    registered: Registered = given(REGISTERED)
    pointer: PointerCalibration = given(POINTER, "pointer")
    found_again: bool = given(REFERENCE, "reference")
    head: HeadReference | None = given(HEAD, "head")


@inputs(implied=("tool", "strokes", *OF_REGISTRATION), free=("use of the base marker",))
class PatternInputs:
    """What a path by rule is drawn on."""

    cloud: SurfaceCloud = given(SURFACE, "surface")
    radius_mm: float = given(RADIUS, "region")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")
    registered: Registered = given(REGISTERED)
    strokes: Strokes = given(SURFACE_CAPTURE, "strokes")
