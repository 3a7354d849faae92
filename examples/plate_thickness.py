"""Thickness of a plate from A-scans of your own: an array of samples is enough.

The lines are made here, two echoes of a short burst in noise. Put your samples in their place.
Run it from the top of the repository: .venv/bin/python -m examples.plate_thickness
"""

import numpy as np

from examples.picture import Series, chart
from rona_core.devices import rf_from_arrays
from rona_core.ultrasound import detect_recorded

SAMPLING_MHZ, SPEED_MM_PER_US = 62.5, 2.85


def lines(thickness_mm: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return A-scans (n, samples) of plates (n,) with two echoes each."""
    times_us = np.arange(2400) / SAMPLING_MHZ
    noise = np.random.default_rng(seed).normal(0.0, 0.01, (len(thickness_mm), len(times_us)))
    for delay_us, level in ((0.0, 1.0), (1.0, -0.4)):
        late = times_us - 12.0 - delay_us * 2.0 * thickness_mm[:, None] / SPEED_MM_PER_US
        noise += level * np.exp(-((late / 0.35) ** 2)) * np.cos(2.0 * np.pi * 2.25 * late)
    return noise


def main(n: int = 40) -> str:
    """Return a chart of the thickness found over the true one."""
    true_mm = np.linspace(4.0, 9.0, n)
    recorded = rf_from_arrays({"rf": lines(true_mm), "fs": 1e6 * SAMPLING_MHZ}, "plates")
    found = detect_recorded(recorded, SPEED_MM_PER_US)
    errors = found.thickness_mm - true_mm
    print(f"median error {np.nanmedian(np.abs(errors)):.3f} mm in {n} lines")
    dots = [Series("found", true_mm, found.thickness_mm, dots=True)]
    return chart("Plates from RF lines", "true thickness (mm)", "found (mm)", dots)


if __name__ == "__main__":
    main()
