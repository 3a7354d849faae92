"""Which roll about the probe axis can the robot follow? The search of the demo session.

Run it from the top of the repository: .venv/bin/python -m examples.compare_rolls
"""

from collections import Counter
from pathlib import Path

import rona_core
from examples.picture import Series, chart

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"


def main() -> str:
    """Return a chart of the margin over the roll, feasible or not."""
    bench = rona_core.open(DEMO)
    roll = bench.session.results.roll
    bench.close()
    if roll is None:
        raise SystemExit("the session has no plan")
    verdicts = roll.value.search.verdicts
    print(Counter("feasible" if v.feasible else str(v.reason) for v in verdicts))
    series = [
        Series(
            label,
            [v.roll_deg for v in verdicts if v.feasible is feasible],
            [v.margin for v in verdicts if v.feasible is feasible],
            dots=True,
        )
        for label, feasible in (("feasible", True), ("refused", False))
    ]
    return chart("Constant rolls along one path", "roll (deg)", "smallest margin", series)


if __name__ == "__main__":
    main()
