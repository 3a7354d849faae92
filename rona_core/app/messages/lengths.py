"""How many values a list in a message may have."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Length:
    """Stands in the annotation of a list: ``Annotated[tuple[Point, ...], Length(0, 500)]``.

    It is checked before any value of the list is looked at, and stands in the schema of REST.
    """

    least: int
    most: int

    def __get_pydantic_core_schema__(
        self, source: Any, handler: Callable[[Any], dict[str, Any]]
    ) -> dict[str, Any]:
        """Add the limits to what a web layer makes of the annotation."""
        return {**handler(source), "min_length": self.least, "max_length": self.most}
