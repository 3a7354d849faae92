"""RONA core: calibration, path planning, ultrasound mapping and the session that holds them.

Works in a bare notebook; knows nothing of the browser or the web server. ``open`` and
``new_session`` give a session with virtual devices, the packages below give the algorithms.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rona_core.compose import new_session
    from rona_core.compose import open_session as open

__version__ = "0.2.0"
__all__ = ["__version__", "new_session", "open"]

_IN_COMPOSE = {"new_session": "new_session", "open": "open_session"}


def __getattr__(name: str) -> Any:
    """Load what puts everything together when it is asked for: ``import rona_core`` stays quick."""
    if name not in _IN_COMPOSE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("rona_core.compose"), _IN_COMPOSE[name])
