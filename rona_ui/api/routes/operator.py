"""Virtual operator: pivots the hand-held pointer by REST, as the mouse does in the page."""

from dataclasses import MISSING, dataclass
from typing import Annotated, ClassVar

from fastapi import APIRouter, Body

from rona_core.devices.limits import quaternion, require_limits, require_unit
from rona_core.devices.settings import STRICT
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import EXACT, Bench

router = APIRouter(
    route_class=BodyRoute, prefix="/sessions/{session_id}/operator", tags=["operator"]
)


@dataclass(frozen=True, slots=True)
class PointerTurn:
    """Rotation of the pointer about its tip, relative to the start, along the axes of the base."""

    __pydantic_config__: ClassVar = STRICT
    wxyz: tuple[float, float, float, float] = quaternion(MISSING, "Rotation")

    def __post_init__(self) -> None:
        require_limits(self)
        require_unit("wxyz", self.wxyz)


@dataclass(frozen=True, slots=True)
class InHand:
    """Whether the pointer is pivoted by hand now."""

    in_hand: bool


@router.get("/pointer")
def get_pointer(bench: Bench) -> InHand:
    """Return whether a capture by hand waits for turns of the pointer."""
    return InHand(bench.pointer_in_hand())


@router.put("/pointer")
def put_pointer(bench: Bench, turn: Annotated[PointerTurn, EXACT, Body()]) -> PointerTurn:
    """Turn the pointer while the job `StartPointerCapture` with `by_hand` runs; live, else 409.

    The hand follows smoothly at a bounded speed; the last rotation counts.
    """
    bench.turn_pointer(turn.wxyz)
    return turn


@router.post("/pointer/finish")
def finish_pointer(bench: Bench) -> InHand:
    """End the pivoting by hand before its time; the calibration follows."""
    bench.finish_pointer()
    return InHand(False)
