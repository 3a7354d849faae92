"""What is known of the burr's tip, in words."""

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.steps.implant.burr.inputs import BurrRegistration
from rona_core.mapping.accuracy.probe_place import SEAT_MM
from rona_core.session.document import Session

UNKNOWN = (
    f"Not registered: the burr may be off by {SEAT_MM:g} mm along each axis, so fewer beds fit."
)


def burr_words(session: Session) -> str:
    """Return what is known of the burr's tip, and whether it is used; empty if not registered."""
    held = session.results.get("burr")
    if held is None:
        return ""
    found: BurrRegistration = held.value
    x, y, z = found.offset_tip.tolist()
    words = (
        f"Tip {np.linalg.norm(found.offset_tip):.2f} mm off its drawing (x {x:+.2f}, y {y:+.2f}, "
        f"z {z:+.2f}), expected error "
        f"{FIGURES['burr_tip_sigma_mm'].words(found.tip_sigma_mm)}"
    )
    judgement = judge_part("burr", session)
    sentence = judgement.beside(words)
    return f"{sentence} The milling is corrected." if judgement.holds else sentence
