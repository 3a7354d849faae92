"""Yardstick of CPU time: a fixed piece of work of numpy, to which times of the same run are put.

Like the procedure it is made of many calls on small arrays, with transforms, products and solutions
of medium ones between them. A time in yardsticks means about the same on any machine; it must not
be changed without measuring again what is written in yardsticks (``benchmarks/suites/procedure``).
"""

import statistics
from collections.abc import Callable
from time import process_time

import numpy as np

from benchmarks.metric import Metric, cpu_ms

REFERENCE_S = 0.077  # of a yardstick, on the machine for which goals are given in seconds
SMALL_ROUNDS, MEDIUM_ROUNDS = 2000, 16  # half of the time each, about


def _small_arrays() -> float:
    """Move four markers about and measure them, as one frame of a tracker would."""
    rotation, _ = np.linalg.qr(np.arange(9.0).reshape(3, 3) + 3.0 * np.eye(3))
    points, total = np.arange(12.0).reshape(4, 3), 0.0
    for turn in range(SMALL_ROUNDS):
        moved = points @ rotation.T + 0.001 * turn
        middle = moved.mean(axis=0)
        lengths = np.sqrt(np.sum((moved - middle) ** 2, axis=1))
        normal = np.cross(moved[1] - moved[0], moved[2] - moved[0])
        total += float(lengths.max() + np.linalg.norm(normal) + np.clip(middle, -1.0, 1.0)[0])
    return total


def _medium_arrays() -> float:
    """Filter A-scans, multiply and solve: what detection and maps do."""
    samples = np.sin(np.arange(64 * 2048.0) ** 1.1).reshape(64, 2048)
    matrix = np.cos(np.arange(160 * 160.0) ** 1.2).reshape(160, 160) + 20.0 * np.eye(160)
    total = 0.0
    for _ in range(MEDIUM_ROUNDS):
        spectrum = np.fft.rfft(samples, axis=1)
        filtered = np.fft.irfft(spectrum * np.conj(spectrum[:1]), 2048, axis=1)
        peaks = np.maximum.accumulate(np.abs(filtered), axis=1)
        product = matrix @ matrix.T @ matrix
        solution = np.linalg.solve(product, matrix)
        total += float(peaks[:, -1].sum() + solution[0, 0] + np.sort(filtered[0])[0])
    return total


def yardstick_s() -> float:
    """Return the CPU time of the yardstick, once, in seconds."""
    start = process_time()
    _small_arrays()
    _medium_arrays()
    return process_time() - start


class Yardstick:
    """Yardsticks laid between pieces of work; the median of the run tells the machine's speed."""

    def __init__(self) -> None:
        """Lay the first ones: the very first, which warms up, does not count."""
        yardstick_s()
        self.times_s = [yardstick_s() for _ in range(3)]

    def lay(self) -> None:
        """Measure once more, beside the work."""
        self.times_s.append(yardstick_s())

    @property
    def median_s(self) -> float:
        """Return the time of one yardstick in this run, in seconds."""
        return statistics.median(self.times_s)


def pair(name: str, spent_s: float, yardstick_s: float, goal_s: float | None) -> list[Metric]:
    """Return a time in yardsticks, with its goal, and in seconds."""
    goal = None if goal_s is None else goal_s / REFERENCE_S
    return [
        Metric(name, spent_s / yardstick_s, "yardsticks", "lower", goal),
        Metric(f"{name}, absolute", spent_s, "s", "lower"),
    ]


def beside_peer(
    name: str,
    work: Callable[[], object],
    goal_s: float,
    peer: str | None,
    theirs: Callable[[], object] | None,
) -> Metric:
    """Return the CPU time of ``work`` in yardsticks with its goal, and of a peer's where it is."""
    yardstick, ours_ms = Yardstick(), cpu_ms(work)
    peer_ms = None if theirs is None else cpu_ms(theirs)
    yardstick.lay()
    ms = 1e3 * yardstick.median_s
    of_peer = None if peer_ms is None else peer_ms / ms
    return Metric(name, ours_ms / ms, "yardsticks", "lower", goal_s / REFERENCE_S, peer, of_peer)
