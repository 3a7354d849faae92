"""A step that is declared for the length of a test."""

from collections.abc import Generator
from contextlib import contextmanager

from rona_core.app.declarations.declarations import Step
from rona_core.app.declarations.registry import REGISTRY


@contextmanager
def declared_step(step: Step) -> Generator[None, None, None]:
    """Declare a step; what was declared before comes back in the end."""
    before = dict(vars(REGISTRY))
    REGISTRY.declare([step])
    try:
        yield
    finally:
        vars(REGISTRY).update(before)
