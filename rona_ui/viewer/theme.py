"""Look of the viewer's widgets: colour of the program, light or dark."""

from typing import Any

BRAND = (0, 91, 143)


def set_theme(gui: Any, *, dark: bool = False) -> None:
    """Give all browsers of a server's ``gui``, or the one of a client's, a light or a dark look."""
    gui.configure_theme(brand_color=BRAND, show_logo=False, show_share_button=False, dark_mode=dark)
