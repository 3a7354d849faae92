"""Beds of implants that lie where a test wants them."""

from dataclasses import asdict, replace

import numpy as np

from rona_core.app.steps.implant.messages import PlaceBed
from rona_core.planning.placement.problem import Placement
from rona_core.session.document import Session


def bed_only(session: Session) -> Session:
    """Return a session with its bed, and no milling of it planned or rehearsed."""
    return session.with_result("rehearsal", None).with_result("milling", None)


def laid_astray(demo: Session) -> Session:
    """Return a session with its bed laid by hand, half outside of the maps."""
    held = demo.results.get("bed")
    assert held is not None
    placed = replace(
        held.value.placed,
        placement=Placement(-20.0, 1.0, np.deg2rad(10.0)),
        lacks="maps",
        chance=None,
        residual_mm=None,
        thinnest_base=None,
        unmapped_mm=0.0,
        screws=(),
    )
    bed = replace(
        held.value,
        lift_mm=0.5,
        placed=placed,
        refusal="it lies outside of the maps: move it",
        tried=(),
        probability=None,
        lacks=None,
    )
    message = PlaceBed(u_mm=-20.0, v_mm=1.0, angle_deg=10.0, lift_mm=0.5)
    by_hand = replace(held, value=bed, message="PlaceBed", arguments=asdict(message))
    return replace(demo, results=demo.results.with_("bed", by_hand))
