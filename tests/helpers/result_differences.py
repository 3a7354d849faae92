"""Compare two results value by value: by how much do they differ, and where most?"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

# Another processor rounds the last bits differently; a decision on the edge may then fall the
# other way. More than this is another program. Measured behind a search: 1e-5 mm of a clearance
# of the second plan, 2e-5 of a check of the first one, 7e-5 mm of the sigma of one A-scan of 600.
CLOSE = 1e-6
CLOSE_BEHIND_A_SEARCH = {"roll": 1e-4, "second": 1e-4, "detection": 2e-4, "second_detection": 2e-4}
SHARE_FLIPPED = 1e-3


@dataclass(frozen=True, slots=True)
class Difference:
    """How far two values of one kind are apart."""

    largest: float  # over all numbers: |a - b| / max(1, |a|, |b|)
    where: str  # of the largest
    n_discrete: int  # whole numbers, truth values and shapes that differ
    n_compared: int

    @property
    def none(self) -> bool:
        """Whether no number differs at all."""
        return self.largest == 0.0 and self.n_discrete == 0


def compare(a: Any, b: Any) -> Difference:
    """Return how far ``b`` is from ``a``; texts (names, sentences, digests) do not count."""
    found: list[tuple[float, int, int, str]] = []
    _walk(a, b, "", found)
    largest, _, _, where = max(found, default=(0.0, 0, 0, ""))
    return Difference(largest, where, sum(f[1] for f in found), sum(f[2] for f in found))


def assert_alike(a: Any, b: Any, result: str, remedy: str = "") -> None:
    """Fail where two values of a result differ by more than another processor's rounding."""
    apart, close = compare(a, b), CLOSE_BEHIND_A_SEARCH.get(result, CLOSE)
    words = f"{result} differs at {apart.where}: {remedy}"
    assert apart.largest <= close, words
    assert apart.n_discrete <= SHARE_FLIPPED * apart.n_compared, words


def _walk(a: Any, b: Any, where: str, found: list[tuple[float, int, int, str]]) -> None:
    if isinstance(a, str) and isinstance(b, str):
        return
    if dataclasses.is_dataclass(a) and type(a) is type(b):
        for f in dataclasses.fields(a):
            _walk(getattr(a, f.name), getattr(b, f.name), f"{where}/{f.name}", found)
    elif isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        for i, (one, other) in enumerate(zip(a, b, strict=True)):
            _walk(one, other, f"{where}/{i}", found)
    elif a is None or b is None:
        found.append((0.0, int(a is not b), 1, where))
    else:
        found.append((*_apart(np.asarray(a), np.asarray(b)), where))


def _apart(a: np.ndarray, b: np.ndarray) -> tuple[float, int, int]:
    if a.shape != b.shape:
        return 0.0, 1, 1
    if a.dtype.kind == "f":
        scale = np.maximum(1.0, np.maximum(np.abs(a), np.abs(b)))
        return float((np.abs(a - b) / scale).max(initial=0.0)), 0, a.size
    return 0.0, int(np.count_nonzero(a != b)), a.size
