"""Manual edits of a path: points moved, inserted, deleted and pinned."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_points, readonly
from rona_core.path.simplification.error_bound import distances_to_segment

Point = tuple[float, float, float]
BY_HAND = -1  # in place of the number of a sample


@dataclass(frozen=True, slots=True)
class PathEdit:
    """One change. Numbers count the points of the path as the changes before have left it.

    "replace": ``points_base`` take the place of all points between ``first`` and ``last``, which
    stay themselves; None stands for what lies beyond the end, so that the end itself goes.
    "keep" and "free": the point ``first`` must stay, or need not.
    """

    kind: Literal["replace", "keep", "free"]
    first: int | None
    last: int | None = None
    points_base: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True)
class PathEdits:
    """All changes of a path by hand, in their order."""

    changes: tuple[PathEdit, ...] = ()

    def __len__(self) -> int:
        return len(self.changes)


@dataclass(frozen=True, slots=True, eq=False)
class EditedPath:
    """A path after changes by hand."""

    points_base: Floats  # (n, 3)
    samples: Ints  # (n,) number in the path before all changes, or BY_HAND
    keep: Bools  # (n,) must stay when the path is smoothed

    def __len__(self) -> int:
        return len(self.points_base)


def edit_path(points_base: ArrayLike, edits: Sequence[PathEdit] = ()) -> EditedPath:
    """Return the path (n, 3) after all changes, in their order.

    The points at both ends of a stretch that was replaced must stay from then on, and so must
    those put in: smoothing leaves the stretch as the hand made it.

    Raises:
        InvalidInputError: a change names points that are not there, or leaves fewer than two.
    """
    points = as_points(points_base, at_least=1, name="points_base")
    samples, keep = np.arange(len(points)), np.zeros(len(points), dtype=np.bool_)
    for number, edit in enumerate(edits):
        first, last = _ends(edit, len(points), number)
        if edit.kind != "replace":
            keep = keep.copy()
            keep[first] = edit.kind == "keep"
            continue
        new = np.array(edit.points_base, dtype=np.float64).reshape(-1, 3)
        if not np.isfinite(new).all():
            raise InvalidInputError(f"change {number} has a place that is not finite")
        before, after = slice(0, first + 1), slice(last, None)
        points = np.concatenate((points[before], new, points[after]))
        samples = np.concatenate((samples[before], np.full(len(new), BY_HAND), samples[after]))
        stays = np.concatenate((keep[before], np.ones(len(new), dtype=np.bool_), keep[after]))
        stays[[max(first, 0), min(first + len(new) + 1, len(stays) - 1)]] = True
        keep = stays
        if len(points) < 2:
            raise InvalidInputError(f"change {number} leaves fewer than two points")
    return EditedPath(readonly(points), readonly(samples), readonly(keep))


def _ends(edit: PathEdit, n: int, number: int) -> tuple[int, int]:
    """Return the points beside the stretch; -1 and n where it goes on beyond an end."""
    first = -1 if edit.first is None else edit.first
    last = n if edit.last is None else edit.last
    if edit.kind == "replace":
        whole = edit.first is None and edit.last is None
        if whole or not -1 <= first < last <= n or edit.first == -1 or edit.last == n:
            raise InvalidInputError(
                f"change {number} must lie between two points of {n}, not {edit.first} and "
                f"{edit.last}"
            )
    elif edit.first is None or not 0 <= first < n:
        raise InvalidInputError(f"change {number} names point {edit.first} of {n}")
    return first, last


def distances_to_edited(points: Floats, path: EditedPath, kept: Ints) -> Floats:
    """Return how far each original sample (m, 3) is from the smoothed path, in mm (m,).

    A sample that is still in the path is measured to the segment that replaces its piece, as K1
    demands; one that was taken away by hand to the nearest segment of what stands in its place.

    Args:
        points: The samples before all changes, raw or filtered.
        path: The path after the changes.
        kept: Increasing indices (k,) into ``path`` of the points of the smoothed path.
    """
    nodes = path.points_base[kept]
    if len(nodes) == 1:
        return np.linalg.norm(points - nodes[0], axis=1)
    remaining = np.flatnonzero(path.samples != BY_HAND)
    sample_numbers, numbers = path.samples[remaining], np.arange(len(points))
    after = np.searchsorted(
        sample_numbers, numbers
    )  # the first sample that is still there, from this on
    exact = np.isin(numbers, sample_numbers)
    bounded = np.concatenate(([0], remaining, [len(path) - 1]))
    low, high = bounded[after + exact], bounded[after + 1]
    first = np.clip(np.searchsorted(kept, low, side="right") - 1, 0, len(kept) - 2)
    last = np.clip(np.searchsorted(kept, high, side="left") - 1, first, len(kept) - 2)
    distances = np.full(len(points), np.inf)
    for step in range(int((last - first).max()) + 1):
        piece = np.minimum(first + step, last)
        distances = np.minimum(
            distances, distances_to_segment(points, nodes[piece], nodes[piece + 1])
        )
    return distances
