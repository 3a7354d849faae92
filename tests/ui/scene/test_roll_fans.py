"""Rolls in the scene: fans of arrows at places along the path, in the colours of the legend."""

from typing import Any

import numpy as np

from rona_core.app.steps.roll.view import MOST_DRAWN
from rona_core.session.document import Session
from rona_ui.presentation.colors import BLUE, GREEN, VERMILLION
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.roll import APART_MM, CHOSEN, CHOSEN_MM, FAILS, MOST_FANS, WORKS, RollsLayer
from rona_ui.scene.roll import spread as spread_over
from tests.ui.panels.test_panels import snapshot
from tests.ui.scene.test_volume import Nodes

LINES = 3  # of an arrow


def fans(demo: Session, view: ViewState) -> dict[str, Any]:
    nodes = Nodes()
    RollsLayer(nodes).render(None, snapshot(demo, view=view))  # type: ignore[arg-type]
    return nodes.drawn


def test_every_fan_has_the_same_rolls_and_the_selected_one(demo: Session) -> None:
    drawn, search = fans(demo, ViewState(step="roll")), demo.results.roll.value.search  # type: ignore
    count = len(drawn[CHOSEN][0]) // LINES
    assert 4 <= count <= MOST_FANS
    works, fails = (len(drawn[name][0]) // LINES for name in (WORKS, FAILS))
    assert works % count == fails % count == 0
    assert (works + fails) // count == MOST_DRAWN
    share = sum(v.feasible for v in search.verdicts) / len(search.verdicts)
    assert abs(works / (works + fails) - share) < 1.5 / MOST_DRAWN
    assert [drawn[name][1] for name in (WORKS, FAILS, CHOSEN)] == [GREEN, VERMILLION, BLUE]


def test_a_fan_stands_where_the_roll_is_looked_at_and_the_others_far_from_it(demo: Session) -> None:
    path = demo.results.roll.value.search.path.points_base  # type: ignore[union-attr]
    for place, at in ((0.0, path[0]), (1.0, path[-1])):
        tips = fans(demo, ViewState(step="roll", place=place))[CHOSEN][0][::LINES, 1]
        apart = np.linalg.norm(tips - at, axis=1)
        assert apart.min() < CHOSEN_MM + 2.0
        near = np.linalg.norm(tips[:, None] - tips[None], axis=2)[~np.eye(len(tips), dtype=bool)]
        assert near.min() > 0.8 * APART_MM  # tips of one roll are as far apart as their feet


def test_a_short_path_has_one_fan() -> None:
    assert spread_over(np.linspace((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), 21), 4).tolist() == [4]
