"""Unseen node: what stands for a node of the scene until the browser has to know it."""

from typing import Any


class UnseenNode:
    """A node that the browser has not been sent: its attributes are those it will be sent with."""

    kind: str
    options: dict[str, Any]
    visible: bool

    def __init__(self, kind: str, options: dict[str, Any]) -> None:
        self.__dict__.update(kind=kind, options=options, visible=True)

    def __setattr__(self, name: str, value: Any) -> None:
        """Keep what is written to the node."""
        if name == "visible":
            self.__dict__["visible"] = value
        else:
            self.__dict__["options"][name] = value

    def remove(self) -> None:
        """Nothing has been sent, so there is nothing to take back."""
