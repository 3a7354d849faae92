"""No stale result looks like one that counts: in every step it is gone, or drawn in grey."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.devices.live import LiveState
from rona_core.session.document import Session
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.renderer import SceneRenderer
from rona_ui.window.background import milling_of
from tests.ui.scene.test_camera import SCENE

ALL = ViewState(all_layers=True, hidden=frozenset())
VIEWED = (
    *(replace(ALL, step=step) for step in ("path", "smoothing", "roll", "scan", "maps", "implant")),
    replace(ALL, step="maps", second=True),
)
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


@lru_cache(8)
def look_of(session: Session) -> Snapshot:
    made = Snapshot(session, ALL, step_states(session), LiveState(), static_scene=SCENE)
    return replace(made, milling=milling_of(session))


def look(session: Session, view: ViewState) -> Snapshot:
    return replace(look_of(session), view=view)


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


class Window:
    """One browser's scene, drawn from one session and view after the other."""

    def __init__(self) -> None:
        self.scene = FakeScene()
        self._old: Snapshot | None = None
        self._parts = ErrorBoundary()
        self._renderer = SceneRenderer(self.scene, self._parts)

    def draw(self, session: Session, view: ViewState) -> dict[str, tuple[Any, ...]]:
        new = look(session, view)
        self._renderer.render(self._old, new)
        assert not self._parts.errors
        self._old = new
        return seen(self.scene)


def made_stale(session: Session, name: str) -> Session:
    held = session.results.get(name)
    assert held is not None
    inputs = {key: f"not {digest}" for key, digest in held.inputs.items()}
    stale = session.with_result(name, replace(held, inputs=inputs))
    assert stale_reason(name, stale) is not None
    return stale


def is_grey(node: SimpleNamespace) -> bool:
    colors = np.array(getattr(node, "colors", getattr(node, "color", ())))
    return colors.size > 0 and bool((np.ptp(colors.reshape(-1, 3).astype(int), axis=1) <= 1).all())


@pytest.mark.parametrize(
    "name", ["maps", *(pytest.param(n, marks=pytest.mark.ci) for n in sorted(DRAWN - {"maps"}))]
)
def test_what_is_drawn_of_a_stale_result_is_grey_or_gone(demo: Session, name: str) -> None:
    stale, without, found = made_stale(demo, name), demo.with_result(name, None), 0
    window, empty = Window(), Window()
    for view in VIEWED:
        fresh, bare = window.draw(demo, view), empty.draw(without, view)
        of_it = {n for n, form in fresh.items() if bare.get(n) != form} - {"/skull"}  # a window
        found += len(of_it)
        now = window.draw(stale, view)
        still = {node for node in of_it & set(now) if bare.get(node) != now[node]}
        assert [node for node in still if not is_grey(window.scene.sent[node])] == [], view.step
        assert window.draw(demo, view) == fresh  # in its colours when it counts again
    assert found > 0
