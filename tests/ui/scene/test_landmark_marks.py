"""Step 8: the verification on landmarks as a table, and its marks in the scene."""

import numpy as np
import pytest

from rona_core.app.steps.scan.landmarks.view import LandmarkReport, LandmarkRow
from rona_ui.panels.scan.scan import WORDS, landmark_note
from rona_ui.scene.pointer import ARM_MM, crosses

ROWS = (
    LandmarkRow("near left", (510.0, 230.0, 350.0), (511.0, 230.0, 350.0), 1.0, 0.33, 0.99),
    LandmarkRow("far middle", (770.0, 60.0, 330.0), None, None, None, None),
)


@pytest.mark.parametrize("state", WORDS)
def test_every_state_is_said_in_words(state):
    html = landmark_note(LandmarkReport(state, "because <so>", ROWS, 1.0, 0.33))
    assert WORDS[state] in html
    assert "<so>" not in html
    assert ("far middle" in html) == (state != "missing")


def test_each_landmark_stands_beside_what_is_expected_and_allowed():
    html = landmark_note(LandmarkReport("failed", "bumped", ROWS, 1.0, 0.33))
    for words in ("near left", "1.00", "0.33", "0.99", "–", "must not scan. bumped"):
        assert words in html


def test_a_cross_is_drawn_where_the_robot_touched():
    lines = crosses(LandmarkReport("passed", "", ROWS))
    assert lines.shape == (6, 2, 3)
    np.testing.assert_allclose(lines[:3].mean(axis=(0, 1)), ROWS[0].robot_base_mm)
    np.testing.assert_allclose(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1), 2.0 * ARM_MM)
    assert crosses(LandmarkReport("missing", "")).shape == (0, 2, 3)
