"""Figures of a rehearsed milling: what it left of the true bone, and how the implant sits there."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.implant.bed_milling import MillingView, burr_way_of, raised_view
from rona_core.app.steps.implant.milling_motion import milling_model, require_certified
from rona_core.app.steps.implant.rehearsal import Rehearsal
from rona_core.app.steps.implant.view import milling_view
from rona_core.evaluation.figures import Figures
from rona_core.evaluation.milling.milled_bed import seated
from rona_core.evaluation.truth import Truth
from rona_core.planning.rehearsal.site import BurrWay
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
    raised = found.raised_plan and found.raised_plan.certified_motion
    figures: Figures = {
        "rehearsal_residual_mm": found.residual_mm,
        "rehearsal_raised_mm": found.raised_mm,
        "rehearsal_raised_s": raised and raised.duration_s,
    }
    site = milled_again(session, found, scene)
    if site is None:
        return figures
    figures["rehearsal_residual_true_mm"] = min(site.least_mm)
    if not found.stopped:
        seat = seated(milling_view(session).implant, site.left_bone())
        figures["rehearsal_implant_high_mm"] = seat.high_mm
        figures["rehearsal_rock_mm"] = seat.rock_mm
    return figures


def milled_again(
    session: "Session", found: Rehearsal, scene: VirtualScene
) -> VirtualMillingSite | None:
    """Return the site as a rehearsal left it: the burr goes the same way once more.

    None where nothing was milled, or where the way is not known: files of earlier versions do not
    hold the motion of raised layers.
    """
    _, motion = require_certified(session)
    view = milling_view(session)
    way = burr_way_of(view, motion)
    rows, pause = np.arange(len(way)), int(np.searchsorted(way.layers, found.pause, side="right"))
    first, rest = way.part(rows < pause), way.part(rows >= pause)
    if found.ceiling_mm is not None:
        rest = _raised(view, found, rest).after(first)
    if not 0 < found.steps <= len(first) + len(rest):
        return None
    site = VirtualMillingSite(scene, milling_model(session, view), found.number)
    left = found.steps
    for part in (first, rest):
        driven = part.part(np.arange(len(part)) < left)
        left -= len(driven)
        if len(driven):
            site.follow(driven)
            site.drive()
    return site


def _raised(view: MillingView, found: Rehearsal, planned: BurrWay) -> BurrWay:
    """Return the way along the raised layers, without a place where they were not milled."""
    motion, ceiling = found.raised_plan and found.raised_plan.certified_motion, found.ceiling_mm
    left = None if ceiling is None else raised_view(view, found.pause, ceiling)
    if left is None or motion is None:
        return planned.part(np.zeros(len(planned), dtype=np.bool_))
    return burr_way_of(left, motion)
