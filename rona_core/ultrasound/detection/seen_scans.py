"""Detections at the A-scans alone at which a tracker saw the probe, and over all of them."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from rona_core.geometry.arrays import Bools, readonly
from rona_core.ultrasound.detection.detect import Detection

NOT_SEEN = 9  # flag of an A-scan at which the tracker did not see the probe


def spread(detection: Detection, known: Bools) -> Detection | None:
    """Return what was found at the A-scans that count, over all of them (n,); else None.

    Args:
        detection: Of as many A-scans as are known.
        known: At which of the n the tracker saw the probe.
    """
    if len(detection) != np.count_nonzero(known):
        return None
    wide: dict[str, Any] = {}
    for part in fields(detection):
        values = getattr(detection, part.name)
        if isinstance(values, np.ndarray):
            held = np.zeros((len(known), *values.shape[1:]), dtype=values.dtype)
            held[known] = values
            if part.name == "flag":
                held[~known] = NOT_SEEN
            wide[part.name] = readonly(held)
    return replace(detection, **wide)


def gathered(detection: Detection, known: Bools) -> Detection:
    """Return the part of a detection over all A-scans (n,) at which the probe was seen."""
    parts: dict[str, Any] = {part.name: getattr(detection, part.name) for part in fields(detection)}
    kept: dict[str, Any] = {
        n: readonly(v[known]) for n, v in parts.items() if isinstance(v, np.ndarray)
    }
    return replace(detection, **kept)
