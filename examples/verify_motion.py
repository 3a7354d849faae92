"""What does the verifier say if one joint is bent? A certified motion with a small bump in it.

Run it from the top of the repository: .venv/bin/python -m examples.verify_motion
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import rona_core
from examples.picture import Series, chart
from rona_core.robot import NOTHING_AROUND, robot_model, verify_motion

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"
BUMP_DEG = 3.0


def main(bump_deg: float = BUMP_DEG) -> str:
    """Return a chart of the joint, certified and bent."""
    bench = rona_core.open(DEMO)
    plan = bench.session.results.roll
    bench.close()
    if plan is None:
        raise SystemExit("the session has no plan")
    motion = plan.value.trajectory
    if motion is None:
        raise SystemExit("the plan has no motion")
    angles = motion.qs_rad.copy()
    middle = len(angles) // 2
    angles[middle : middle + 3, 3] += np.deg2rad(bump_deg)
    model = robot_model("rx90")
    for words, one in (("as planned", motion), ("bent", replace(motion, qs_rad=angles))):
        certificate = verify_motion(model, one, obstacles=NOTHING_AROUND)
        broken = [check.sentence for check in certificate.checks if not check.holds]
        print(f"{words}: certified {certificate.certified}", *broken, sep="\n  ")
    rows = slice(middle - 40, middle + 40)
    series = [
        Series("bent", motion.times_s[rows], np.rad2deg(angles[rows, 3])),
        Series("certified", motion.times_s[rows], np.rad2deg(motion.qs_rad[rows, 3])),
    ]
    return chart("A motion that the verifier refuses", "time (s)", "joint 4 (deg)", series)


if __name__ == "__main__":
    main()
