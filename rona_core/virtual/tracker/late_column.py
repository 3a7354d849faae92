"""Samples of one tool that are worked out when somebody asks: captures look at few of the tools."""

from collections.abc import Callable

from rona_core.devices.samples import ToolSample


class LateColumn:
    """The samples of one tool in n frames, worked out once, when the first is asked for."""

    __slots__ = ("_compute", "_samples")

    def __init__(self, compute: Callable[[], list[ToolSample]]) -> None:
        """Take what gives them (n,); it depends on nothing that may change."""
        self._compute: Callable[[], list[ToolSample]] | None = compute
        self._samples: list[ToolSample] = []

    def __call__(self) -> list[ToolSample]:
        """Return them."""
        compute = self._compute  # two threads may do it at once, none waits
        if compute is not None:
            self._samples = compute()
            self._compute = None  # what they were made of is let go
        return self._samples
