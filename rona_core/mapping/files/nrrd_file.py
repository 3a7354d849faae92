"""NRRD (Kindlmann 2004) of arrays in ``base``: the same array gives the same bytes."""

import io
import re
from typing import Any

import numpy as np

SPACE = "left-posterior-superior"  # what x, y, z of base count as in all files
WRITTEN_ON = re.compile(rb"^# on .*\n", re.MULTILINE)  # pynrrd writes the time


def nrrd_bytes(values: np.ndarray, header: dict[str, Any]) -> bytes:
    """Return an array as a NRRD file, compressed; lengths are mm."""
    import nrrd  # here: few sessions are written as volumes

    fields = {"space": SPACE, "space units": ["mm"] * 3, "encoding": "gzip", "frame": "base"}
    file = io.BytesIO()
    nrrd.write(file, values, {**fields, **header}, compression_level=6)
    return WRITTEN_ON.sub(b"", file.getvalue(), count=1)
