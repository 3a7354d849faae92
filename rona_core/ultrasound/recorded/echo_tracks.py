"""Tracks of echoes behind the front, followed from scan to scan."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    minimum_spanning_tree,
)
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.robust import MAD_TO_SIGMA
from rona_core.ultrasound.recorded.band import Band, Complexes, noise_rms

RISE = 2.0  # of an echo, over the quietest moment between the front and it
PEAKS = 20  # kept for each scan
LEAST_SNR = 3.5  # of a peak of the envelope over the rms of the noise
TRACKS = 10
LEAST_COVERAGE = 0.4
MENDED = 0.5  # of the pulse length: farther off what neighbours predict, a scan has strayed
MENDINGS = 12  # each brings back scans beside those that stayed
NEIGHBOURS = 8
TEAR = 4.0  # cost of a break between neighbours
STEP = 0.6  # lag over the pulse length that costs 1
PLANE_RIDGE = 0.02  # neighbours on one line say nothing of the slope across it
FULL_DB = 80.0  # over the noise; louder peaks count no more


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """The strongest peaks behind the front, (n, PEAKS); level 0 where there are fewer."""

    lag_us: Floats
    level: Floats  # over the front
    noise: Floats  # (n,) on the same scale


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One echo through all scans."""

    lag_us: Floats  # (n,) after the front; meaningless where not present
    level: Floats  # (n,)
    present: Bools  # (n,)

    @property
    def typical_us(self) -> float:
        """Return the median lag."""
        return float(np.median(self.lag_us[self.present]))

    @property
    def typical_level(self) -> float:
        """Return the median level over the front."""
        return float(np.median(self.level[self.present]))


def spaced_by_one(positions: Floats | None) -> Floats | None:
    """Return positions (n, 1 to 3) with a typical distance of 1 between neighbours, from 0 on.

    Whatever their unit: equal distances stay equal to the last digit. None where all are the same.
    """
    if positions is None or len(positions) < 2 or np.ptp(positions, axis=0).max() == 0:
        return None
    place = positions - positions.min(axis=0)
    distance = KDTree(place).query(place, k=2)[0][:, 1]
    apart = distance[distance > 1e-6 * np.ptp(place, axis=0).max()]
    return np.round(place / np.median(apart), 6) if len(apart) else None


def neighbour_tree(ok: Bools, positions_mm: Floats | None) -> tuple[Ints, Ints]:
    """Return an order of the scans that count, and the parent (n,) of each, -1 at the root.

    The shortest tree that joins their positions; without positions, the order of the file.
    """
    index = np.flatnonzero(ok)
    n = len(index)
    parents = np.full(len(ok), -1, dtype=np.int64)
    place = None if positions_mm is None else positions_mm[index]
    if place is None or n < 3 or np.ptp(place, axis=0).max() == 0:
        parents[index[1:]] = index[:-1]
        return index, parents
    count = min(NEIGHBOURS + 1, n)
    distance, other = KDTree(place).query(place, k=count)
    # the order of the file joins what is too far apart to be neighbours
    chain = np.linalg.norm(np.diff(place, axis=0), axis=1) + float(distance.max())
    weights = np.concatenate((distance.ravel(), chain)) + 1e-9
    starts = np.concatenate((np.repeat(np.arange(n), count), np.arange(n - 1)))
    ends = np.concatenate((other.ravel(), np.arange(1, n)))
    kept = starts != ends
    starts, ends = np.minimum(starts, ends)[kept], np.maximum(starts, ends)[kept]
    _, first = np.unique(starts * n + ends, return_index=True)
    graph = coo_matrix((weights[kept][first], (starts[first], ends[first])), shape=(n, n))
    order, above = breadth_first_order(minimum_spanning_tree(graph.tocsr()), 0, directed=False)
    parents[index] = np.where(above < 0, -1, index[np.clip(above, 0, None)])
    return index[order].astype(np.int64), parents


def neighbours(n: int, positions_mm: Floats | None) -> Ints:
    """Return the nearest scans (n, k) of each scan, itself left out; by order without positions."""
    if positions_mm is None or n < 2 or np.ptp(positions_mm, axis=0).max() == 0:
        place = np.arange(n, dtype=np.float64)[:, None]
    else:
        place = positions_mm
    count = min(NEIGHBOURS + 1, n)
    found = np.asarray(KDTree(place).query(place, k=count)[1], dtype=np.int64).reshape(n, count)
    # among scans at one place the first found need not be the scan itself
    itself_column = found == np.arange(n)[:, None]
    itself_column[~itself_column.any(axis=1), -1] = True
    return found[~itself_column].reshape(n, count - 1)


def predicted(values: Floats, present: Bools, near: Ints, positions_mm: Floats | None) -> Floats:
    """Return what the neighbours (n, k) say about each scan: a robust plane through their values.

    NaN where fewer than two of them have a value.
    """
    n = len(values)
    place = np.arange(n, dtype=np.float64)[:, None] if positions_mm is None else positions_mm
    if near.shape[1] < 2:
        return np.full(n, np.nan)
    offset = place[near] - place[:, None, :]
    scale = np.median(np.linalg.norm(offset, axis=2)) + 1e-9
    design = np.concatenate((np.ones((*near.shape, 1)), offset / scale), axis=2)
    value, use = values[near], present[near].astype(np.float64)
    middle = _median(value, present[near])
    result = np.where(np.isfinite(middle), middle, 0.0)
    residual = value - result[:, None]
    size = design.shape[2]
    ridge = PLANE_RIDGE * np.diag([0.0, *([1.0] * (size - 1))]) + 1e-9 * np.eye(size)
    for _ in range(4):
        spread = MAD_TO_SIGMA * _median(np.abs(residual), present[near]) + 1e-6
        weight = use / (
            1.0 + (residual / (2.0 * np.where(np.isfinite(spread), spread, 1.0))[:, None]) ** 2
        )
        normal = np.einsum("nk,nki,nkj->nij", weight, design, design) + ridge
        right = np.einsum("nk,nki,nk->ni", weight, design, value)
        plane = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        residual = value - np.einsum("nki,ni->nk", design, plane)
        result = plane[:, 0]
    return np.where(use.sum(axis=1) >= 2, result, np.nan)


def _median(values: Floats, present: Bools) -> Floats:
    """Return the median (n,) of the values that are present, infinity where none is."""
    count = present.sum(axis=1)
    ordered = np.sort(np.where(present, values, np.inf), axis=1)
    rows, last = np.arange(len(values)), values.shape[1] - 1
    low = ordered[rows, np.clip((count - 1) // 2, 0, last)]
    high = ordered[rows, np.clip(count // 2, 0, last)]
    return np.where(count > 0, 0.5 * (low + np.where(np.isfinite(high), high, low)), np.inf)


def largest_piece(track: Track, near: Ints, step_us: float) -> Bools:
    """Return the scans (n,) of the largest part of a track without a jump.

    Args:
        track: An echo.
        near: Neighbours (n, k) of each scan.
        step_us: By which neighbours may differ.
    """
    first = np.repeat(np.arange(len(near)), near.shape[1])
    second = near.ravel()
    joined = track.present[first] & track.present[second]
    joined &= np.abs(track.lag_us[first] - track.lag_us[second]) < step_us
    graph = coo_matrix((np.ones(joined.sum()), (first[joined], second[joined])), [len(near)] * 2)
    pieces = connected_components(graph, directed=False)[1]
    return track.present & (pieces == np.bincount(pieces[track.present]).argmax())


def find_peaks(
    compressed: Complexes, step_us: float, zero: int, band: Band, least_us: float, ends: Ints
) -> Peaks:
    """Return the peaks of compressed lines (n, samples) from a lag behind sample ``zero`` on.

    What is nearer to the end (n,) of its line than half a pulse is no echo that anybody could time.
    """
    ends = ends - round(0.5 * band.length_us / step_us)
    envelope = np.abs(compressed)
    noise = np.maximum(noise_rms(envelope, zero, band.length_us / step_us), 1e-9)
    first = min(zero + round(least_us / step_us), compressed.shape[1] - 3)
    behind = envelope[:, first:]
    top = np.zeros(behind.shape, dtype=np.bool_)
    top[:, 1:-1] = (behind[:, 1:-1] > behind[:, :-2]) & (behind[:, 1:-1] >= behind[:, 2:])
    top &= behind > LEAST_SNR * noise[:, None]
    # the tail of a front, however loud, only falls
    lowest = np.minimum.accumulate(envelope[:, zero:], axis=1)[:, first - zero :]
    top &= behind > RISE * lowest
    top &= np.arange(behind.shape[1]) < ends[:, None] - first
    value = np.where(top, behind, 0.0)
    count = min(PEAKS, value.shape[1])
    at = np.sort(np.argpartition(value, -count, axis=1)[:, -count:], axis=1)
    level = np.take_along_axis(value, at, axis=1)
    near = [np.take_along_axis(behind, np.clip(at + k, 0, behind.shape[1] - 1), 1) for k in (-1, 1)]
    bend = near[0] - 2.0 * level + near[1]
    flat = (bend >= 0) | (level == 0)
    offset = np.where(flat, 0.0, 0.5 * (near[0] - near[1]) / np.where(flat, -1.0, bend))
    lag_us: Floats = ((first - zero + at + offset) * step_us).astype(np.float64)
    return Peaks(lag_us, level, noise)


def follow(peaks: Peaks, tree: tuple[Ints, Ints], band: Band, ok: Bools) -> list[Track]:
    """Return the echoes that most scans share, the loudest first.

    Each is the best choice of one peak a scan (or none) on the tree of neighbours, found exactly
    from the leaves to the root; its peaks are taken away before the next.
    """
    snr_db = 20.0 * np.log10(np.maximum(peaks.level / peaks.noise[:, None], 1e-9))
    worth = np.clip((snr_db - 10.0) / 10.0, 0.05, (FULL_DB - 10.0) / 10.0)
    alive = (peaks.level > 0) & ok[:, None]
    tracks: list[Track] = []
    while len(tracks) < TRACKS and alive.any():
        choice = _best_choice(np.where(alive, worth, -np.inf), peaks.lag_us, tree, band)
        present = choice >= 0
        if present.sum() < max(1.0, LEAST_COVERAGE * ok.sum()):
            break
        pick = np.clip(choice, 0, None)[:, None]
        lag = np.take_along_axis(peaks.lag_us, pick, 1)[:, 0]
        level = np.take_along_axis(peaks.level, pick, 1)[:, 0]
        tracks.append(Track(lag, level, present))
        close = np.abs(peaks.lag_us - lag[:, None]) < 0.7 * band.length_us
        alive &= ~(close & present[:, None])
    return tracks


def mended(
    track: Track, peaks: Peaks, near: Ints, positions_mm: Floats | None, band: Band
) -> Track:
    """Return a track whose scans that left their neighbours have come back, or are not present."""
    if near.shape[1] < 3:
        return track
    lag, level, present = track.lag_us, track.level, track.present
    reach = MENDED * band.length_us
    for _ in range(MENDINGS):
        around = predicted(lag, present, near, positions_mm)
        off = np.where(peaks.level > 0, np.abs(peaks.lag_us - around[:, None]), np.inf)
        off = np.where(np.isfinite(off), off, np.inf)
        pick = np.argmin(off, axis=1)[:, None]
        nearest = np.take_along_axis(off, pick, 1)[:, 0]
        stray = ~present | (np.abs(lag - around) > reach)
        back = stray & (nearest < reach)
        lag = np.where(back, np.take_along_axis(peaks.lag_us, pick, 1)[:, 0], lag)
        level = np.where(back, np.take_along_axis(peaks.level, pick, 1)[:, 0], level)
        present = (present & ~stray) | back
    return Track(lag, level, present) if present.any() else track


def _best_choice(worth: Floats, lag_us: Floats, tree: tuple[Ints, Ints], band: Band) -> Ints:
    order, parents = tree
    n, count = worth.shape
    scale = STEP * band.length_us
    total = np.column_stack((worth, np.zeros(n)))  # the last state: the echo is not there
    back = np.zeros((n, count + 1), dtype=np.int64)
    for node in order[:0:-1]:
        parent = parents[node]
        if parent < 0:
            continue
        step = np.minimum(np.abs(lag_us[node][:, None] - lag_us[parent]) / scale, TEAR)
        cost = np.full((count + 1, count + 1), 0.5 * TEAR)
        cost[:count, :count] = step
        cost[count, count] = 0.0
        gain = total[node][:, None] - cost
        back[node] = np.argmax(gain, axis=0)
        total[parent] += gain[back[node], np.arange(count + 1)]
    choice = np.full(n, count, dtype=np.int64)
    for node in order:
        parent = parents[node]
        choice[node] = np.argmax(total[node]) if parent < 0 else back[node, choice[parent]]
    missing = (choice == count) | ~np.isfinite(
        np.column_stack((worth, np.zeros(n)))[np.arange(n), choice]
    )
    return np.where(missing, -1, choice)
