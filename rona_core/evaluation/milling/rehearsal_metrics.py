"""Figures of a rehearsed milling: what it left of the true bone, and how the implant sits there."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.implant.milling_derivation import milling_model
from rona_core.app.steps.implant.milling_motion import require_certified
from rona_core.app.steps.implant.rehearsal import Rehearsal
from rona_core.app.steps.implant.rehearsal_task import burr_way
from rona_core.app.steps.implant.view import milling_view
from rona_core.evaluation.figures import Figures
from rona_core.evaluation.milling.milled_bed import seated
from rona_core.evaluation.truth import Truth
from rona_core.planning.rehearsal.depth_correction import corrected_way
from rona_core.session.memo import Memo
from rona_core.virtual.milling.milling_site import VirtualMillingSite
from rona_core.virtual.scene import VirtualScene

if TYPE_CHECKING:
    from rona_core.session.document import Session

_FIGURES: Memo[Figures] = Memo(2)


def rehearsal_figures(session: "Session", truth: Truth) -> Figures:
    """Return what a rehearsal thinks that it left, and what it really left."""
    held = session.results.get("rehearsal")
    if held is None or stale_reason("rehearsal", session) is not None:
        return {}
    return _FIGURES.get((held, truth.scene), lambda: _figures(session, held.value, truth.scene))


def _figures(session: "Session", found: Rehearsal, scene: VirtualScene) -> Figures:
    site = milled_again(session, found, scene)
    figures: Figures = {
        "rehearsal_residual_mm": found.residual_mm,
        "rehearsal_residual_true_mm": min(site.least_mm),
        "rehearsal_raised_mm": found.raised_mm,
    }
    if not found.stopped:
        seat = seated(milling_view(session).implant, site.left_bone())
        figures["rehearsal_implant_high_mm"] = seat.high_mm
        figures["rehearsal_rock_mm"] = seat.rock_mm
    return figures


def milled_again(session: "Session", found: Rehearsal, scene: VirtualScene) -> VirtualMillingSite:
    """Return the site as a rehearsal left it: the burr goes the same way once more."""
    _, motion = require_certified(session)
    view = milling_view(session)
    way = burr_way(view, motion.path_mm, motion.qs_rad, motion.times_s)
    ceiling = -np.inf if found.ceiling_mm is None else found.ceiling_mm
    commanded, _ = corrected_way(way, found.pause, ceiling)
    commanded = commanded.part(np.arange(len(commanded)) < found.steps)
    site = VirtualMillingSite(scene, milling_model(session, view), found.number)
    before = commanded.layers <= found.pause
    for part in (commanded.part(before), commanded.part(~before)):
        if len(part):
            site.follow(part)
            site.drive()
    return site
