"""The reference points of step 9 in the scene: where they are, their numbers, what is doubtful."""

from dataclasses import replace

import numpy as np

from rona_core.app.steps.acoustics.view import ReferenceRow
from rona_core.session.captures import ReferenceCapture
from rona_core.session.document import Captures, Session
from rona_ui.presentation.colors import ORANGE, PURPLE
from rona_ui.presentation.view_state import LAYERS, ViewState
from rona_ui.scene.maps.maps import POINTS, ReferencesLayer, label_words
from tests.ui.panels.test_obstacles_panel import ROOM, SceneNodes
from tests.ui.panels.test_panels import snapshot

MAPS = ViewState(step="maps")
PLACES = np.array([[600.0, 60.0, 400.0], [610.0, 50.0, 398.0], [590.0, 70.0, 399.0]])


class Dots(SceneNodes):
    """Remembers points and colours of dots, too."""

    def dots(self, node, points, colors, *, size_px):
        if len(points):
            self.colors[node] = (points, colors)
        else:
            self.remove(node)


def measured(n):
    thickness, sigma = np.linspace(5.0, 7.0, n), np.full(n, 0.1)
    held = ReferenceCapture(0, "", PLACES[:n], thickness, sigma)
    return Session(captures=Captures(references=held))


def test_points_have_their_places_and_numbers_and_go_with_the_layer():
    nodes = Dots()
    layer = ReferencesLayer(nodes)
    three = snapshot(measured(3), view=MAPS, static_scene=ROOM)
    layer.render(None, three)
    points, colors = nodes.colors[POINTS]
    np.testing.assert_allclose(points, PLACES + (0.0, 0.0, 1.0))
    assert (colors == PURPLE).all()
    assert sorted(nodes.texts.values()) == ["1", "2", "3"]
    assert all(nodes.seen.values())
    hidden = replace(three, view=replace(MAPS, hidden=frozenset({"references"})))
    layer.render(three, hidden)
    assert len(nodes.seen) == 4
    assert not any(nodes.seen.values())
    two = snapshot(measured(2), view=MAPS, static_scene=ROOM)
    layer.render(hidden, two)
    assert sorted(nodes.texts.values()) == ["1", "2"]
    layer.render(two, snapshot(view=MAPS, static_scene=ROOM))
    assert nodes.texts == nodes.colors == {}
    assert "references" in LAYERS


def test_a_doubtful_point_is_orange_and_told(monkeypatch):
    rows = (ReferenceRow(0, 5.0, 0.021, 2.65, True), ReferenceRow(1, 7.0, -0.9, 2.2, False))
    monkeypatch.setattr("rona_ui.scene.maps.maps.reference_rows", lambda session: rows)
    nodes = Dots()
    ReferencesLayer(nodes).render(None, snapshot(measured(2), view=MAPS))
    assert nodes.colors[POINTS][1].tolist() == [list(PURPLE), list(ORANGE)]
    assert label_words(rows[0]) == "1"
    assert label_words(rows[1]) == "2 doubtful"
