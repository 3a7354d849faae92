"""Map the skull with the probe in the hand, tracked, and without the robot: the SonoPointer.

Run it with the Python of the project: .venv/bin/python examples/scan_by_hand.py
"""

from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import new_workbench
from rona_core.session.document import Session


def main(seed: int = 0, scan: StartHandheldScan | None = None) -> dict[str, float]:
    """Calibrate, scan and map; return the figures against the truth of a virtual scene."""
    bench = new_workbench(Session(name="by hand"))
    try:
        bench.dispatch(SetSeed(seed))
        for activity in (
            StartHandheldCalibration(),
            scan or StartHandheldScan(),
            StartHandheldMapping(),
        ):
            bench.run(activity)
        results = bench.session.results
        figures = {key: v for key, v in bench.figures().items() if key.startswith("sono_")}
    finally:
        bench.close()
    if results.sono is not None and results.sono_maps is not None:
        probe, maps = results.sono.value, results.sono_maps.value
        print(f"probe: {probe.verdict}, axis known to {probe.axis_sigma_deg:.2f} deg")
        print(f"maps: {maps.n_posed} of {maps.n_scans} A-scans have a pose. {maps.sentence}")
    for key, value in figures.items():
        print(f"{key}: {value:.3f}")
    return figures


if __name__ == "__main__":
    main()
