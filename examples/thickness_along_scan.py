"""How thick is the bone along the scan, and how sure is it? The A-scans of the demo session.

Run it from the top of the repository: .venv/bin/python -m examples.thickness_along_scan
"""

from pathlib import Path

import numpy as np

import rona_core
from examples.picture import Series, chart

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"


def main() -> str:
    """Return a chart of the thickness where the inner boundary was found."""
    bench = rona_core.open(DEMO)
    detection = bench.session.results.detection
    bench.close()
    if detection is None:
        raise SystemExit("the session has no detection")
    found = detection.value
    number = np.flatnonzero(found.inner_ok)
    thickness = found.thickness_mm[number]
    print(f"inner boundary in {len(number)} of {len(found.inner_ok)} A-scans")
    print(f"median {np.median(thickness):.2f} mm, {np.ptp(thickness):.2f} mm between extremes")
    dots = [Series("thickness", number, thickness, dots=True)]
    return chart("Bone thickness along the scan", "A-scan", "mm", dots)


if __name__ == "__main__":
    main()
