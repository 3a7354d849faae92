import numpy as np
import pytest

from rona_core.evaluation.map_metrics import bed_figures, residual_mm
from rona_core.session.document import Session
from tests.core.evaluation.test_map_metrics import THICKNESS_MM
from tests.core.evaluation.test_navigation_metrics import truth_of


@pytest.mark.parametrize("depth_mm", [2.0, 5.5, 7.0])
def test_what_a_floor_leaves_is_the_thickness_less_its_depth(depth_mm):
    """Places below a sphere of even thickness, one of them deepest; below the bone is negative."""
    truth = truth_of(4)
    specimen = truth.scene.specimen
    center = truth.scene.T_base_skull @ np.array(specimen.center)
    _, normal, _ = truth.scene.region_base()
    aside = np.cross(normal, (0.0, 1.0, 0.0))
    ways = normal + 0.1 * np.array([[0.0], [1.0], [-1.0]]) * aside
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    depths = depth_mm - np.array([0.0, 0.4, 0.8])
    floor = center + (specimen.radius_mm - depths)[:, None] * ways
    assert residual_mm(floor, truth) == pytest.approx(THICKNESS_MM - depth_mm, abs=0.01)


def test_without_a_bed_there_are_no_figures():
    assert bed_figures(Session(), truth_of(4)) == {}
