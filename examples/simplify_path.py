"""How many points does a scan path need? The demonstrated path of the demo session, simplified.

Run it from the top of the repository: .venv/bin/python -m examples.simplify_path
"""

from pathlib import Path

import numpy as np

import rona_core
from examples.picture import Series, chart
from rona_core.path import simplify

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"


def main(n_bounds: int = 20) -> str:
    """Return a chart of the number of points over the bound."""
    bench = rona_core.open(DEMO)
    raw = bench.session.results.path
    bench.close()
    if raw is None:
        raise SystemExit("the session has no path")
    points = raw.value.points_base
    bounds = np.geomspace(0.1, 3.0, n_bounds)
    kept = [len(simplify(points, tolerance=float(bound)).index) for bound in bounds]
    print(f"{len(points)} recorded points; {kept[0]} within 0.1 mm, {kept[-1]} within 3 mm")
    line = [Series("points kept", bounds, kept)]
    return chart("Points of a simplified scan path", "bound (mm)", "points", line)


if __name__ == "__main__":
    main()
