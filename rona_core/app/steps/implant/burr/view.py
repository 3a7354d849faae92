"""What is known of the burr's tip, in words."""

import numpy as np

from rona_core.app.dependencies.judged import Judged
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.implant.burr.registration import BurrRegistration
from rona_core.mapping.accuracy.probe_place import SEAT_MM
from rona_core.session.document import Session

UNKNOWN = (
    f"Not registered: the burr may be off by {SEAT_MM:g} mm along each axis, so fewer beds fit."
)


def burr_view(session: Session) -> Judged | None:
    """Return what is known of the tip of the burr; None where it was not registered."""
    held = session.results.get("burr")
    if held is None:
        return None
    found: BurrRegistration = held.value
    x, y, z = found.offset_tip.tolist()
    words = (
        f"Tip {np.linalg.norm(found.offset_tip):.2f} mm off its drawing (x {x:+.2f}, y {y:+.2f}, "
        f"z {z:+.2f}), expected error {found.tip_sigma_mm:.2f} mm"
    )
    reason = stale_reason("burr", session)
    if reason is not None:
        return Judged(f"{words}. Not used: {reason}.", "stale")
    if found.verdict == "bad":
        return Judged(f"{'; '.join((words, *found.reasons))}. Not used.", "bad")
    return Judged(f"{'; '.join((words, *found.reasons))}. The milling is corrected.", found.verdict)
