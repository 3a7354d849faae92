"""A demonstrated scan path like the paper's: a meander on a sphere, drawn by an unsteady hand.

Lines of 60 mm, 5 mm apart, with round turns, on a sphere of 80 mm; 35 s, the speed changing and
lower in the turns; tremor 0.3 mm at 6 to 12 Hz, wander 1.0 mm at 0.2 to 1.5 Hz and 0.35 mm of the
tracker (3D RMS each). The noise was chosen so that the paper's method keeps about as many points
as in the paper, which does not publish its path; so that agreement is no validation.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats

LINES, LENGTH_MM, SPACING_MM, RADIUS_MM = 9, 60.0, 5.0, 80.0
DURATION_S = 35.0


def demonstration(
    seed: int, n: int, *, spacing_mm: float = SPACING_MM, passes: int = 1, noise: float = 1.0
) -> Floats:
    """Return samples (n, 3) in mm, evenly spaced in time.

    Args:
        seed: Of speed and noise.
        n: Number of samples.
        spacing_mm: Between the lines.
        passes: How often the meander is gone through, there and back.
        noise: Factor on tremor, wander and tracker noise.
    """
    rng = np.random.default_rng((11, seed))
    curve, turning = _curve(spacing_mm)
    curve = np.vstack([curve[:: (-1) ** k] for k in range(passes)])
    turning = np.concatenate([turning[:: (-1) ** k] for k in range(passes)])
    times = np.linspace(0.0, DURATION_S * passes, n)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    pace = np.exp(0.35 * _tones(rng, np.linspace(0, DURATION_S * passes, len(curve)), 0.05, 0.5, 1))
    slow = np.where(turning, 2.0, 1.0)[:, None] / pace
    clock = np.concatenate(([0.0], np.cumsum(np.diff(along) * slow[1:, 0])))
    at = np.interp(times, clock / clock[-1] * times[-1], along)
    path = np.column_stack([np.interp(at, along, column) for column in curve.T])
    wobble = 0.3 * _tones(rng, times, 6.0, 12.0, 3) + 1.0 * _tones(rng, times, 0.2, 1.5, 3)
    white = rng.normal(0.0, 0.35 / np.sqrt(3.0), (n, 3))
    return path + noise * (wobble + white)


def _curve(spacing_mm: float) -> tuple[Floats, Bools]:
    """Return the noise-free curve (k, 3), and where it turns (k,)."""
    half, turn = LENGTH_MM / 2.0, spacing_mm / 2.0
    pieces: list[Floats] = []
    for row in range(LINES):
        y, side = (row - (LINES - 1) / 2.0) * spacing_mm, (-1) ** row
        x = side * np.linspace(-half, half, 50)
        pieces.append(np.column_stack((x, np.full(50, y), np.zeros(50))))
        if row < LINES - 1:
            angle = np.linspace(-np.pi / 2, np.pi / 2, 22)[1:-1]
            arc = (side * (half + turn * np.cos(angle)), y + turn + turn * np.sin(angle))
            pieces.append(np.column_stack((*arc, np.ones(20))))
    flat = np.vstack(pieces)
    height = np.sqrt(RADIUS_MM**2 - (flat[:, :2] ** 2).sum(axis=1))
    return np.column_stack((flat[:, :2], height)), flat[:, 2] > 0.5


def _tones(
    rng: np.random.Generator, times_s: Floats, low_hz: float, high_hz: float, axes: int
) -> Floats:
    """Return motion (n, axes) of 40 tones each, RMS 1 over all axes together."""
    frequency = rng.uniform(low_hz, high_hz, (axes, 40))
    phase = rng.uniform(0.0, 2.0 * np.pi, (axes, 40))
    motion = np.zeros((len(times_s), axes))
    for k in range(40):
        motion += np.sin(2.0 * np.pi * np.outer(times_s, frequency[:, k]) + phase[:, k])
    return motion / np.sqrt((motion**2).sum(axis=1).mean())
