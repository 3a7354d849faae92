"""All figures of one session against the truth of its virtual scene; ``truth.py`` declares them.

A figure whose result is missing is None, so is one that compares a result with a capture which has
been taken again since, and so is one whose capture came out of a file: there is no truth for what
was measured elsewhere.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.staleness import made_of
from rona_core.app.overview.predicted_accuracy import predicted_figures
from rona_core.app.steps.surface.messages import TakeCloud
from rona_core.evaluation.map_metrics import (
    bed_figures,
    map_figures,
    one_pass_figures,
    sono_calibration_figures,
    sono_map_figures,
)
from rona_core.evaluation.milling_metrics import rehearsal_figures
from rona_core.evaluation.navigation_metrics import (
    burr_figures,
    normal_figures,
    plan_figures,
    pointer_figures,
    skull_figures,
    smoothing_figures,
    surface_figures,
    tool_figures,
)
from rona_core.evaluation.scan_metrics import (
    cause_figures,
    contact_figures,
    detected_passes,
    detection_figures,
    head_shift_figures,
    speed_figures,
)
from rona_core.evaluation.truth import Figures, Truth, truth_of
from rona_core.session.captures import is_imported
from rona_core.virtual.rig import build_scene
from rona_core.virtual.scene import VirtualScene

if TYPE_CHECKING:
    from rona_core.session.document import Session


def evaluate(session: "Session", scene: VirtualScene) -> Figures:
    """Return every figure of ``FIGURES``, in that order.

    Args:
        session: The session, with whatever results it has so far.
        scene: The ground truth: seed and specimen of the same session. Where its settings are
            not those of the session any more, it is built anew.

    ``wall_s`` is left None: the caller that ran the procedure sets it.
    """
    if scene.settings != session.setup.devices:
        scene = build_scene(scene.seed, scene.specimen, session.setup.devices, scene.world)
    truth = truth_of(session, scene)
    figures: Figures = dict.fromkeys(FIGURES)
    for part in (_navigation, _path, _scan, bed_figures, rehearsal_figures):
        figures |= part(session, truth)
    figures |= _by_hand(session, Truth(scene, truth.postures))  # which nothing leads back to step 4
    step, reason = unfinished(session)
    figures |= {"completed": step is None, "failed_step": step, "reason": reason}
    return figures


def unfinished(session: "Session") -> tuple[str | None, str | None]:
    """Return the first step without a result, and why; (None, None) if all are done."""
    results = session.results
    plan = results.roll.value if results.roll else None
    if plan is not None and plan.trajectory is None and results.maps is None:
        return "roll", "no roll makes the path traversable: move the robot base"
    done = {
        "tool": results.tool,
        "pointer": results.pointer,
        "surface": results.surface,
        "path": results.path,
        "smoothing": results.smoothing,
        "roll": results.roll,
        "scan": session.captures.scan,
        "maps": results.maps,
    }
    for step, result in done.items():
        if result is None:
            return step, f"the step {step!r} has no result yet"
    return None, None


def _navigation(session: "Session", truth: Truth) -> Figures:
    results, figures = session.results, Figures(predicted_figures(session))
    if results.tool is not None and not is_imported(session.captures.tool):
        taken = session.captures.tool
        place = None if taken is None else taken.tracker_place
        figures |= tool_figures(results.tool.value, truth, place)
    if (burr := results.get("burr")) and not is_imported(session.captures.get("burr")):
        figures |= burr_figures(burr.value, truth)
    if results.pointer is not None and not is_imported(session.captures.pointer):
        figures |= pointer_figures(results.pointer.value, truth)
    if results.surface is not None:
        strokes = session.captures.surface
        figures["surface_points"] = len(results.surface.value.points_base)
        known = made_of(results.surface, "capture", strokes)
        if not _foreign_surface(session):
            figures |= surface_figures(results.surface.value, strokes if known else (), truth)
            if results.registration is not None:
                figures |= skull_figures(results.registration.value, truth)
    return figures


def _foreign_surface(session: "Session") -> bool:
    """Return whether the surface came out of a file: no virtual device knows its truth."""
    made = session.results.surface
    cloud = made is not None and made.message == TakeCloud.__name__
    return cloud or any(map(is_imported, session.captures.surface))


def _path(session: "Session", truth: Truth) -> Figures:
    results, figures = session.results, Figures()
    if results.path is not None:
        figures["path_points_raw"] = len(results.path.value.points_base)
    if results.smoothing is not None:
        figures |= smoothing_figures(_with_path_of_smoothing(session))
        if not (is_imported(session.captures.path) or _foreign_surface(session)):
            figures |= normal_figures(results.smoothing.value.path, truth)
    if results.roll is not None:
        figures |= plan_figures(results.roll.value)
    return figures


def _with_path_of_smoothing(session: "Session") -> "Session":
    """Return the session without a demonstrated path that was not the one smoothed."""
    smoothing, path, capture = (
        session.results.smoothing,
        session.results.path,
        session.captures.path,
    )
    if smoothing is None or path is None or capture is None:
        return session
    if made_of(smoothing, "path", path.value) and made_of(path, "capture", capture):
        return session
    return replace(session, captures=replace(session.captures, path=None))


def _scan(session: "Session", truth: Truth) -> Figures:
    results, figures = session.results, Figures()
    scan = session.captures.scan
    if scan is not None:
        figures["scan_points"] = len(scan.scans)
        figures |= contact_figures(scan)
        if is_imported(scan):  # no virtual device knows its truth
            return figures
        figures |= head_shift_figures(session, truth)
        passes = detected_passes(session)
        if passes:
            maps = results.maps if len(passes) > 1 else None
            used = None if maps is None else maps.value.inner_used
            figures |= detection_figures(passes, truth, used)
            figures |= speed_figures(session, truth)
    if session.captures.second:
        figures["second_pass_points"] = sum(len(one.scans) for one in session.captures.second)
    if results.maps is not None:
        figures |= map_figures(results.maps.value, truth)
        if results.detection is not None:
            n_first = len(results.detection.value)
            figures |= one_pass_figures(results.maps.value, n_first, truth)
    return figures | cause_figures(session, truth)


def _by_hand(session: "Session", truth: Truth) -> Figures:
    results, figures = session.results, Figures()
    if results.sono is not None:
        figures |= sono_calibration_figures(results.sono.value, truth)
    if results.sono_maps is not None:
        figures |= sono_map_figures(results.sono_maps.value, truth)
    return figures
