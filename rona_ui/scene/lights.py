"""Lights: a lamp over the surgeon's shoulder, a weak one across, and light from all sides."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import Rgb

SKY, GROUND, AROUND = (255, 255, 255), (150, 146, 142), 1.5  # from above, from below, strength
# direction to the lamp in base, its colour and its strength; from the side of the cameras, so that
# relief on the region throws shades and no face of a thing is black
LAMPS: tuple[tuple[tuple[float, float, float], Rgb, float], ...] = (
    ((-0.35, -0.85, 0.75), (255, 250, 242), 2.1),
    ((0.8, 0.5, 0.5), (232, 240, 255), 0.5),
)


def light(scene: Any) -> None:
    """Light a scene of the viewer, in place of its own lamps and surroundings."""
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(hdri=None)
    scene.add_light_hemisphere(
        "/lights/around", sky_color=SKY, ground_color=GROUND, intensity=AROUND
    )
    for number, (towards, color, strength) in enumerate(LAMPS):
        scene.add_light_directional(
            f"/lights/lamp{number}",
            color=color,
            intensity=strength,
            position=tuple(10.0 * unit(towards)),
        )


def unit(direction: ArrayLike) -> Floats:
    """Return a direction (3,) of length 1."""
    along = np.asarray(direction, dtype=np.float64)
    return along / np.linalg.norm(along)
