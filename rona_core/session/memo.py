"""Memo: a bounded, locked cache of what was computed from immutable values."""

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, Generic, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")
_ALL: "weakref.WeakSet[Memo[Any]]" = weakref.WeakSet()


class Memo(Generic[T]):
    """A bounded, locked cache over the identity of immutable values.

    It keeps the values alive as long as it remembers them, so that no other one can get the same
    identity. `forget_all` empties every memo of the process, as when a session is closed.
    """

    def __init__(self, size: int) -> None:
        """Remember at most ``size`` results; the ones that were not asked for longest go first."""
        self._size = size
        self._lock = threading.Lock()
        self._held: OrderedDict[Hashable, tuple[tuple[object, ...], T]] = OrderedDict()
        _ALL.add(self)

    def __len__(self) -> int:
        """Return how many results are remembered."""
        return len(self._held)

    def get(self, values: tuple[object, ...], compute: Callable[[], T], key: Hashable = None) -> T:
        """Return what ``compute()`` gives for these very values and this key.

        It is computed outside of the lock: two threads may compute the same at once, none waits.
        What it raises is not remembered.
        """
        place = (*map(id, values), key)
        with self._lock:
            known = self._held.get(place)
            if known is not None:
                self._held.move_to_end(place)
                return known[1]
        made = compute()
        with self._lock:
            self._held[place] = values, made
            while len(self._held) > self._size:
                self._held.popitem(last=False)
        return made

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._held.clear()


def remember(size: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that remembers ``size`` results of a pure function, by its arguments.

    The arguments are immutable and hashable: of sessions, captures and results the identity counts.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        memo: Memo[T] = Memo(size)

        @wraps(function)
        def remembered(*args: P.args, **kwargs: P.kwargs) -> T:
            key = (args, tuple(sorted(kwargs.items())))
            return memo.get((), lambda: function(*args, **kwargs), key)

        return remembered

    return decorate


def forget_all() -> None:
    """Empty every memo of this process: sessions that were closed are not kept alive by them."""
    for memo in list(_ALL):
        memo.clear()
