"""What has to be there before something can be computed."""

from typing import Any

from rona_core.errors import StepBlockedError


def need(value: Any, wanted: str) -> Any:
    """Return ``value``; raise StepBlockedError that says what to do first where it is missing."""
    if value in (None, ()):
        raise StepBlockedError(f"first {wanted}")
    return value
