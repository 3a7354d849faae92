"""How late is one device against another? Positions of the same hand, recorded by two clocks.

Run it from the top of the repository: .venv/bin/python -m examples.time_offset
"""

import numpy as np

from examples.picture import Series, chart
from rona_core.calibration import estimate_time_offset


def hand(times_s: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return positions (n, 3) in mm of a hand that wanders."""
    rng = np.random.default_rng(seed)
    rates, phases = rng.uniform(0.2, 1.7, (6, 3)), rng.uniform(0.0, 6.3, (6, 3))
    return 20.0 * np.sin(2.0 * np.pi * rates * times_s[:, None, None] + phases).sum(axis=1)


def main(n: int = 9) -> str:
    """Return a chart of the delay found over the one put in."""
    rng = np.random.default_rng(1)
    a_s, b_s = np.arange(0.0, 20.0, 1 / 60), np.arange(0.0, 20.0, 1 / 100)
    delays_ms = np.linspace(-80.0, 80.0, n)
    found_ms: list[float] = []
    for delay_ms in delays_ms:
        a = hand(a_s) + rng.normal(0.0, 0.2, (len(a_s), 3))
        b = hand(b_s - delay_ms / 1e3) + rng.normal(0.0, 0.2, (len(b_s), 3))
        found_ms.append(1e3 * estimate_time_offset(a_s, a, b_s, b).offset_s)
    print(f"largest error {np.abs(found_ms - delays_ms).max():.2f} ms")
    dots = [Series("found", delays_ms, found_ms, dots=True)]
    return chart("Delay between two devices", "put in (ms)", "found (ms)", dots)


if __name__ == "__main__":
    main()
