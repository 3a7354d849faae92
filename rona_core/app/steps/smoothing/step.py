"""Smoothing: fewest points within a bound, surface normals, dense 5D path."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.inputs import result_input
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.path.painting import PAINTED
from rona_core.app.steps.smoothing.derivation import derive_smoothing
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.session.document import Session

SMOOTHING, PATH, SURFACE = (result_input(name) for name in ("smoothing", "path", "surface"))
EDITS = Input(lambda s: s.path_edits, "smooth the path (step 6)")


def _summary(session: Session) -> str:
    held = session.results.smoothing
    if held is None:
        return ""
    smooth = held.value
    kept, off_mm = smooth.simplified, float(smooth.from_filtered_mm.max())
    by_hand = f", {len(session.path_edits)} by hand" if len(session.path_edits) else ""
    return f"{kept.n_original} to {len(kept.index)} points, max. deviation {off_mm:.2f} mm{by_hand}"


STEP = declare.Step(
    "smoothing",
    commands=(declare.Command(SmoothScanPath, compute_result, needs=(PATH, SURFACE)),),
    results=(
        declare.Result(
            "smoothing",
            SmoothScanPath,
            derive_smoothing,
            {"path": PATH, "surface": SURFACE, "edits": EDITS, "painted regions": PAINTED},
            "smooth the path (step 6)",
        ),
    ),
    line=declare.StepLine(
        "Smoothing", _summary, SmoothScanPath, leaves=lambda session: (SMOOTHING,)
    ),
)
