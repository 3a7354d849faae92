"""Measured places stand on the drawn skull: raised where they lie within, else left alone."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.geometry.mesh import Mesh
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.viser_nodes import on_bone
from tests.ui.scene.test_camera import MIDDLE, SCENE

RADIUS_MM, HEIGHT_MM = 75.0, 0.6
INSIDE_OUT = replace(SCENE, skull=Mesh(SCENE.skull.vertices, SCENE.skull.faces[:, ::-1]))


def about(directions: np.ndarray, heights_mm: np.ndarray) -> np.ndarray:
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return MIDDLE + (RADIUS_MM + heights_mm[:, None]) * unit


@pytest.mark.parametrize("scene", [SCENE, INSIDE_OUT], ids=["outwards", "inside out"])
def test_what_lies_in_the_bone_is_raised_and_what_is_above_it_stays(scene: StaticScene) -> None:
    rng = np.random.default_rng(0)
    places = about(rng.normal(size=(200, 3)), rng.normal(0.0, 1.0, 200))
    raised = on_bone(places, scene, HEIGHT_MM)
    # the ball is of triangles of some 10 mm, which lie up to 0.2 mm within it
    heights = np.linalg.norm(raised - MIDDLE, axis=1) - RADIUS_MM
    assert heights.min() >= HEIGHT_MM - 0.3
    before = np.linalg.norm(places - MIDDLE, axis=1) - RADIUS_MM
    np.testing.assert_array_equal(raised[before > 1.0], places[before > 1.0])
    assert (np.linalg.norm(raised - places, axis=1) <= HEIGHT_MM + 0.3 - before)[before < 0].all()


def test_what_is_not_on_this_skull_and_what_has_none_stays() -> None:
    far = MIDDLE[None] + 5.0
    np.testing.assert_array_equal(on_bone(far, SCENE, HEIGHT_MM), far)
    np.testing.assert_array_equal(on_bone(far, None, HEIGHT_MM), far)
