"""Samples of one tool, computed on access: captures look at few of the tools."""

from collections.abc import Callable

from rona_core.devices.samples import ToolColumn


class LateColumn:
    """The samples of one tool in n frames, computed once, on first access."""

    __slots__ = ("_column", "_compute")

    def __init__(self, compute: Callable[[], ToolColumn]) -> None:
        """Take what gives them (n,); it depends on nothing that may change."""
        self._compute = compute
        self._column: ToolColumn | None = None

    def __call__(self) -> ToolColumn:
        """Return them."""
        column = self._column  # two threads may work it out at once, none waits
        if column is None:
            column = self._column = self._compute()
            self._compute = lambda: column  # what they were made of is let go
        return column
