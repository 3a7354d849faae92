"""Smoothing: fewest points within a bound, surface normals, dense 5D path."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.staleness import result_input
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.path.inputs import PATH
from rona_core.app.steps.smoothing.derivation import smooth_path
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.session.document import Session

SMOOTHING = result_input("smoothing")


def _summary(session: Session) -> str:
    held = session.results.smoothing
    if held is None:
        return ""
    smooth = held.value
    kept, off_mm = smooth.simplified, float(smooth.from_filtered_mm.max())
    by_hand = f", {len(session.path_edits)} by hand" if len(session.path_edits) else ""
    off = FIGURES["path_deviation_max_mm"].words(off_mm)
    return f"{kept.n_original} to {len(kept.index)} points, max. deviation {off}{by_hand}"


STEP = declare.Step(
    "smoothing",
    commands=(declare.Command(SmoothScanPath, compute_result, needs=(PATH, SURFACE)),),
    results=(
        declare.Result.of(
            "smoothing",
            SmoothScanPath,
            smooth_path,
            "smooth the path (step 6)",
            done="the scan path was smoothed",
        ),
    ),
    line=declare.StepLine(
        "Smoothing", _summary, SmoothScanPath, leaves=lambda session: (SMOOTHING,)
    ),
)
