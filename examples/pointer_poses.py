"""How many poses does a pivot calibration need? The first n poses of a recorded pointer.

Run it from the top of the repository: .venv/bin/python -m examples.pointer_poses
"""

from pathlib import Path

import numpy as np

import rona_core
from examples.picture import Series, chart
from rona_core.calibration import calibrate_pointer
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry import Poses

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"


def main(n_counts: int = 12) -> str:
    """Return a chart of the standard deviation of the tip over the number of poses."""
    bench = rona_core.open(DEMO)
    capture = bench.session.captures.pointer
    bench.close()
    if capture is None:
        raise SystemExit("the session has no pointer")
    poses = capture.marker.Ts_tracker_marker
    markers = GEOMETRIES["pointer6d"].positions_marker
    rng = np.random.default_rng(0)
    counts = np.unique(np.geomspace(30, len(poses), n_counts).astype(int))
    sigmas: list[float] = []
    for count in counts:
        some = np.sort(rng.choice(len(poses), count, replace=False))
        seen = Poses(poses.rotations[some], poses.translations[some])
        found = calibrate_pointer(seen, pointer="pointer6d", dof=6, positions_pointermarker=markers)
        sigmas.append(found.tip_sigma_mm)
    print(f"{counts[0]} poses: {sigmas[0]:.3f} mm, {counts[-1]} poses: {sigmas[-1]:.3f} mm")
    line = [Series("standard deviation of the tip", counts, sigmas)]
    return chart("Pivot calibration of a pointer", "poses", "mm", line)


if __name__ == "__main__":
    main()
