"""The session as a whole: what is asked before work goes out of sight, and the open sessions."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry
from rona_core.errors import InvalidInputError
from rona_core.session.document import Session
from rona_ui.panels.layout.session import Choice, Question, SessionPanel, head
from rona_ui.window.browser import Browser
from tests.helpers.ui.fake_gui import FakeClient, FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

A, B = Session(id="a1", name="bone"), Session(id="b2", name="bone")
OPENED = (("a1", "bone"), ("b2", "bone"))


def panel(**parts: Any) -> tuple[FakeGui, Recorder]:
    gui, recorder = FakeGui(), Recorder()
    shown = SessionPanel(gui, recorder.context)
    files = (Path("old+new.rona"),)
    shown.render(None, snapshot(B, opened=OPENED, files=files, **parts))
    return gui, recorder


def press(gui: FakeGui, label: str) -> None:
    gui.find("button", label).happen(CLIENT)


def answers(gui: FakeGui) -> list[str]:
    """Return the answers of the question that is open."""
    modal = next(
        (n for n, h in enumerate(gui.handles) if h.kind == "modal" and not h.removed), None
    )
    return [] if modal is None else [h.label for h in gui.handles[modal:] if h.kind == "button"]


def test_without_changes_nothing_is_asked() -> None:
    gui, recorder = panel()
    gui.find("dropdown", "File").value = "old+new.rona"
    for label in ("New session", "Open file", "Close session"):
        press(gui, label)
    assert recorder.services == ["new", "open:old+new.rona", "close:b2"]
    assert not [h for h in gui.handles if h.kind == "modal"]


@pytest.mark.parametrize(
    ("button", "answer", "services"),
    [
        ("New session", "Save first", ["save:b2+new"]),
        ("New session", "Keep open, unsaved", ["new"]),
        ("New session", "Cancel", []),
        ("Open file", "Save first", ["save:b2+open:old+new.rona"]),
        ("Open file", "Keep open, unsaved", ["open:old+new.rona"]),
        ("Close session", "Save and close", ["save:b2+drop:b2"]),
        ("Close session", "Close without saving", ["drop:b2"]),
        ("Close session", "Cancel", []),
    ],
)
def test_with_changes_it_is_asked_first(button: str, answer: str, services: list[str]) -> None:
    gui, recorder = panel(changes=True)
    gui.find("dropdown", "File").value = "old+new.rona"
    press(gui, button)
    assert recorder.services == []
    assert "has unsaved changes" in gui.html()
    assert answer in answers(gui)
    press(gui, answer)
    assert recorder.services == services
    assert answers(gui) == []


def test_the_open_sessions_are_listed_and_one_is_chosen() -> None:
    gui, recorder = panel()
    chosen = gui.find("dropdown", "Open sessions")
    assert (chosen.options, chosen.value) == (("1: bone", "2: bone"), "2: bone")
    chosen.value = "1: bone"
    chosen.happen(None)  # an echo of our own write
    assert recorder.services == []
    chosen.happen(CLIENT)
    assert recorder.services == ["show:a1"]


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"saved": True}, "saved"),
        ({}, "● not saved"),
        ({"copy": "kept"}, "● not saved, copy kept"),
        ({"recovered": True, "copy": "kept"}, "● recovered, not saved"),
        ({"recovered": True, "copy": "failed"}, "● recovered, not saved, no space for a copy"),
    ],
)
def test_the_head_says_how_the_session_stands(parts: dict[str, Any], words: str) -> None:
    assert f">{words}</span>" in head(snapshot(A, **parts))


@pytest.fixture
def served(tmp_path: Path):
    """A hub, and a function that carries a service of the browser out on it."""
    hub = build_registry(tmp_path, processes=False)
    browser = SimpleNamespace(_hub=hub, client=FakeClient())
    for name in ("_serve", "_close"):
        setattr(browser, name, getattr(Browser, name).__get__(browser))
    yield hub, lambda what: browser._serve(what, None)
    hub.close_all()


def test_saved_first_then_left(served: Any, tmp_path: Path) -> None:
    hub, serve = served
    (tmp_path / "a+b.rona").write_bytes(b"damaged")
    bench = hub.create("bone")
    bench.dispatch(SetSeed(1))
    serve(f"save:{bench.session.id}+new")
    assert hub.is_saved(bench.session.id)
    assert (len(hub.ids()), hub.get() is bench) == (2, False)
    serve(f"show:{bench.session.id}")
    assert hub.get() is bench
    with pytest.raises(Exception, match="not a readable"):
        serve(f"save:{bench.session.id}+open:a+b.rona")
    assert hub.get() is bench


def test_what_has_changed_meanwhile_is_not_closed_and_the_last_leaves_a_new_one(
    served: Any,
) -> None:
    hub, serve = served
    bench = hub.create("bone")
    bench.dispatch(SetSeed(1))
    key = bench.session.id
    with pytest.raises(InvalidInputError, match="changed meanwhile"):
        serve(f"close:{key}")
    assert hub.ids() == (key,)
    serve(f"drop:{key}")
    assert hub.get().session.name == "untitled"
    assert key not in hub.ids()
    assert hub.lost() == ()


def test_a_question_is_answered_with_cancel_once():
    class Modal:
        closed = 0

        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

        def close(self):
            self.closed += 1

    gui, modal, done = FakeGui(), Modal(), []
    gui.add_modal = lambda title: modal
    question = Question(gui)
    assert not question.cancel()  # nothing is asked: Esc means something else
    question.ask("Leave?", "Not saved.", (Choice("Close", done.append, "lose"),))
    assert question.cancel()
    assert not question.cancel()
    assert (modal.closed, done) == (1, [])
