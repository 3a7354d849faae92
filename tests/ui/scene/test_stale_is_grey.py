"""No result that is stale looks like one that counts: in every step it is gone, or drawn in grey."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.devices.live import LiveState
from rona_core.session.document import Session
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.renderer import SceneRenderer
from rona_ui.window.background import milling_of
from tests.ui.panels.test_obstacles_panel import ROOM

ALL = ViewState(all_layers=True, hidden=frozenset())
VIEWS = {
    "steps": ("path", "smoothing", "roll", "scan", "maps", "implant"),
    "second": (False, True),
}
DRAWN = {"surface", "path", "smoothing", "roll", "detection", "second", "maps", "bed"}


class FakeScene:
    """Keeps what is sent by name."""

    def __init__(self) -> None:
        self.sent: dict[str, SimpleNamespace] = {}

    def __getattr__(self, kind: str) -> Any:
        def add(name: str, **options: Any) -> SimpleNamespace:
            node = SimpleNamespace(kind=kind, visible=True, **options)
            node.remove = lambda: self.sent.pop(name, None)
            self.sent[name] = node
            return node

        return add if kind.startswith("add_") else lambda *_, **__: None


def look(session: Session, view: ViewState) -> Snapshot:
    made = Snapshot(session, view, step_states(session), LiveState(), static_scene=ROOM)
    return replace(made, milling=milling_of(session))


def seen(scene: FakeScene) -> dict[str, tuple[Any, ...]]:
    """Return form and colours of what is to be seen, by name."""
    return {
        name: tuple(
            np.array(getattr(node, part, 0)).tobytes()
            for part in ("points", "vertices", "position", "wxyz", "colors", "color", "text")
        )
        for name, node in scene.sent.items()
        if node.visible
    }


def drawn(session: Session, view: ViewState, before: Session | None = None) -> FakeScene:
    renderer = SceneRenderer(scene := FakeScene())
    old = None if before is None else look(before, view)
    if old is not None:
        renderer.render(None, old)
    renderer.render(old, look(session, view))
    return scene


def made_stale(session: Session, name: str) -> Session:
    held = session.results.get(name)
    assert held is not None
    inputs = {key: f"not {digest}" for key, digest in held.inputs.items()}
    stale = session.with_result(name, replace(held, inputs=inputs))
    assert stale_reason(name, stale) is not None
    return stale


def is_grey(node: SimpleNamespace) -> bool:
    colors = np.array(getattr(node, "colors", getattr(node, "color", ())))
    return colors.size > 0 and bool((np.ptp(colors.reshape(-1, 3), axis=1) == 0).all())


VIEWED = [
    replace(ALL, step=step, second=second)
    for step in VIEWS["steps"]
    for second in VIEWS["second"]
    if not second or step == "maps"
]


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_what_is_drawn_of_a_stale_result_is_grey_or_gone(demo: Session, name: str) -> None:
    stale, found = made_stale(demo, name), 0
    for view in VIEWED:
        whole, without = drawn(demo, view), drawn(demo.with_result(name, None), view)
        now, fresh, bare = drawn(stale, view, before=demo), seen(whole), seen(without)
        of_it = {node for node, form in fresh.items() if bare.get(node) != form}
        found += len(of_it)
        still = {node for node, form in seen(now).items() if bare.get(node) != form} & of_it
        assert [node for node in still if not is_grey(now.sent[node])] == [], view.step
        again = drawn(demo, view, before=stale)
        assert seen(again) == fresh  # and in its colours when it counts again
    assert found > 0
