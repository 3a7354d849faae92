"""What the page round the viewer is told of a view, and what it can ask for."""

import html
import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_ui.panels.layout import page_link
from rona_ui.panels.layout.page_link import PageLink
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import LAYERS, MODES, NEEDED, Drawing, ViewState
from rona_ui.viewer import theme
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

SCENE = StaticScene("VIRTUAL", *[np.zeros(3)] * 6, head_axes_base=np.eye(3))  # type: ignore
HEAD = ["AP", "Vertex", "Lateral L", "Lateral R"]
TABLE = ["Top", "Left", "Right"]


class Page:
    """The page's end of the link."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(page_link, "uuid_of", lambda handle: f"uuid-{handle.label}")
        self.gui, self.recorder = FakeGui(), Recorder()
        self.themes: list[Any] = []
        self.gui.configure_theme = lambda **parts: self.themes.append(parts)
        start = SimpleNamespace(label="Start")
        self.link = PageLink(self.gui, self.recorder.context, {"start": start}, ("Log", "Path"))

    def ask(self, act: Any, value: Any = None, client: Any = CLIENT) -> None:
        self.write(json.dumps({"act": act, "value": value}), client)

    def write(self, text: str, client: Any = CLIENT) -> None:
        field = self.gui.find("text", "Page")
        field.value = text
        field.happen(client)

    @property
    def told(self) -> dict[str, Any]:
        (state,) = re.findall(r'data-state="([^"]*)"', self.gui.html())
        return json.loads(html.unescape(state))


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    return Page(monkeypatch)


def test_it_tells_the_view_and_which_buttons_it_has_keys_for(page: Page) -> None:
    view = ViewState(step="maps", cut_direction="crosswise", cut_offset_mm=-3.5, cut_maps=True)
    page.link.render(None, snapshot(view=view, static_scene=SCENE))
    told = page.told
    assert told["buttons"] == {"start": "uuid-Start"}
    assert (told["step"], told["ready"], told["drawing"]) == ("maps", True, False)
    assert (told["cut"], told["cut_offset"], told["cut_maps"]) == ("crosswise", -3.5, True)
    layers = {each["name"]: each for each in told["layers"]}
    assert set(layers) == set(LAYERS) - {"outer", "inner", "fused"}  # step 9 has fields for these
    for name, each in layers.items():
        assert each["shown"] == (name not in view.hidden)
        assert each["needed"] == (name in NEEDED["maps"])


def test_views_of_the_head_have_their_names_only_where_its_axes_are_known(page: Page) -> None:
    room, old = ["Overview", "Region", "Oblique", "Robot"], None
    for scene, names in (
        (None, [*HEAD, *TABLE]),
        (SCENE, HEAD),
        (replace(SCENE, head_axes_base=None), TABLE),
    ):
        new = snapshot(static_scene=scene)
        page.link.render(old, new)
        assert page.told["cameras"] == [*room, *names]
        old = new
    for name in (*room, *HEAD, *TABLE):
        page.ask("camera", name)
    assert page.recorder.looks == [*room, *HEAD, *TABLE]


def test_it_is_written_only_when_something_of_it_changes(page: Page) -> None:
    old = snapshot()
    page.link.render(None, old)
    written = page.gui.handles[-1]
    written.content = "as it was"
    page.link.render(old, replace(old, refused=3))
    assert written.content == "as it was"
    page.link.render(old, replace(old, view=ViewState(step="tool")))
    assert page.told["step"] == "tool"


def test_what_the_page_asks_for_is_done_in_order_with_the_rest(page: Page) -> None:
    for act in ("undo", "redo", "save", "escape"):
        page.ask(act)
    assert [type(message).__name__ for message in page.recorder.sent] == ["Undo", "Redo"]
    assert page.recorder.services == ["save", "escape"]
    page.ask("layer", {"name": "skull", "shown": False})
    page.ask("layer", {"name": "obstacles", "shown": True})
    page.ask("all_layers", True)
    page.ask("cut", "lengthwise")
    page.ask("cut_offset", -12)
    page.ask("cut_maps", True)
    shown = page.recorder.shown
    assert shown.hidden == ViewState().hidden - {"obstacles"} | {"skull"}
    assert (shown.all_layers, shown.cut_direction) == (True, "lengthwise")
    assert (shown.cut_offset_mm, shown.cut_maps) == (-12.0, True)
    page.ask("tabs", ["Path", "Log"])
    assert page.recorder.shown.open_tabs == {"Log", "Path"}
    for name in ("dark", "light"):
        page.ask("theme", name)
    assert [parts["dark_mode"] for parts in page.themes] == [True, False]
    assert all(parts["brand_color"] == theme.BRAND for parts in page.themes)


def test_a_key_counts_from_the_view_as_it_is_whatever_the_page_has_heard(page: Page) -> None:
    seen = []
    for _ in range(3):
        page.ask("flip", "all_layers")
        page.ask("flip", "cut")
        seen.append((page.recorder.shown.all_layers, page.recorder.shown.cut_direction))
    assert seen == [(True, "lengthwise"), (False, "off"), (True, "lengthwise")]
    page.ask("cut", "crosswise")
    page.ask("flip", "cut")
    assert page.recorder.shown.cut_direction == "lengthwise"


def test_the_skull_is_whole_while_somebody_draws(page: Page) -> None:
    page.recorder.shown = ViewState(drawing="path")
    page.ask("cut", "crosswise")
    assert page.recorder.shown == ViewState(drawing="path")


def test_an_echo_of_our_own_write_does_nothing(page: Page) -> None:
    page.ask("undo", client=None)
    page.ask("cut", "crosswise", client=None)
    assert page.recorder.sent == []
    assert page.recorder.shown == ViewState()


@pytest.mark.parametrize(
    ("act", "value"),
    [
        ("format the disk", None),
        ("camera", "From behind"),
        ("camera", ["AP"]),
        ("layer", {"name": "skull"}),
        ("layer", {"name": "walls", "shown": True}),
        ("layer", "skull"),
        ("all_layers", 1),
        ("flip", "step"),
        ("cut", "across"),
        ("cut_offset", 60.1),
        ("cut_offset", float("nan")),
        ("cut_offset", "5"),
        ("tabs", ["Path", "Log", "Elsewhere"]),
        ("tabs", 3),
        ("theme", None),
        (["undo"], None),
    ],
)
def test_what_nobody_knows_is_refused_and_changes_nothing(page: Page, act: Any, value: Any) -> None:
    with pytest.raises(InvalidInputError, match="load it again"):
        page.ask(act, value)
    assert (page.recorder.shown, page.recorder.looks, page.themes) == (ViewState(), [], [])


@pytest.mark.parametrize("text", ["", "undo", "[]", "{}", '"undo"', "[" * 100_000])
def test_what_cannot_be_read_is_refused(page: Page, text: str) -> None:
    with pytest.raises(InvalidInputError, match="load it again"):
        page.write(text)


@pytest.mark.parametrize("mode", get_args(Drawing))
def test_it_tells_in_words_what_a_click_on_the_skull_does(page: Page, mode: Drawing) -> None:
    page.link.render(None, snapshot(view=ViewState(drawing=mode), static_scene=SCENE))
    assert page.told["mode"] == MODES[mode]
    assert page.told["pressed"] == {"move": "Move", "insert": "Insert"}.get(
        mode, {"delete": "Delete", "pin": "Pin"}.get(mode, "")
    )


def test_without_a_mode_it_tells_none(page: Page) -> None:
    page.link.render(None, snapshot(view=ViewState(), static_scene=SCENE))
    assert (page.told["mode"], page.told["pressed"]) == ("", "")
