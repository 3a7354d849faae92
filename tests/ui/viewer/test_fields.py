"""What is typed is taken as a whole or refused with a reason; the contract with viser's page."""

import asyncio
import json
import zipfile
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from viser._icons import svg_from_icon

from rona_core.errors import InvalidInputError
from rona_ui.viewer import fields as fields_module
from rona_ui.viewer.fields import DECIMALS, Field, Fields, read_number
from rona_ui.viewer.gateway import ViewerGateway, uuid_of
from tests.helpers.ui.fake_gui import FakeClient, FakeGui, FakeHandle

CLIENT = FakeClient()


class Page:
    """The page: sends what was typed into a field, and keeps what was refused."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(fields_module, "uuid_of", lambda handle: f"uuid-{id(handle)}")
        self.gui, self.refused = FakeGui(), []
        self.fields = Fields(self.gui, lambda error, *_: self.refused.append(str(error)))
        self.heard: list[Any] = []

    def add(self, kind: str, *arguments: Any, **options: Any) -> Field:
        field = getattr(self.fields, f"add_{kind}")(*arguments, **options)
        handle = field._handle
        handle.value = arguments[1] if kind != "slider" else arguments[4]
        handle.min, handle.max = options.get("min"), options.get("max")
        if kind == "slider":
            handle.min, handle.max = arguments[1:3]

        @field.on_update
        async def _(event: Any) -> None:
            if event.client is not None:
                self.heard.append((event.client, event.finished, field.value))

        return field

    def finish(self, field: Field, text: str, part: int = 0) -> None:
        sent = {"field": f"uuid-{id(field._handle)}", "part": part, "text": text, "number": 1}
        self.send(json.dumps(sent))

    def send(self, mail: str) -> None:
        handle = self.gui.find("text", "Typed")
        handle.value = mail
        handle.happen(CLIENT)


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    return Page(monkeypatch)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("30", 30.0),
        (" -2.5 ", -2.5),
        ("12,5", 12.5),
        (".5", 0.5),
        ("5.", 5.0),
        ("1e9", 1e9),
        ("2.5E-3", 2.5e-3),
        ("+7", 7.0),
        ("\N{MINUS SIGN}3", -3.0),
        ("1,0000", 1.0),
    ],
)
def test_a_number_is_read_as_people_write_it(text: str, value: float) -> None:
    assert read_number(text) == value


@pytest.mark.parametrize(
    "text",
    ["", "abc", "3mm", "1e", "-", "1.2.3", "nan", "inf", "1e999", "1_000", "1 000", "1,000",
     "1,000,000", "1,2,3", "0x10", "\N{ARABIC-INDIC DIGIT THREE}"],
)  # fmt: skip
def test_what_is_no_number_or_may_be_two_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match=r"expected a number such as 2\.5, not"):
        read_number(text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_is_read_back_exactly(value: float) -> None:
    assert read_number(repr(value)) == value


def test_a_finished_number_is_written_and_told_once(page: Page) -> None:
    field = page.add("number", "Radius (mm)", 25.0, min=5.0, max=45.0)
    page.finish(field, "30")
    assert (field.value, type(field.value)) == (30.0, float)
    assert page.heard == [(CLIENT, True, 30.0)]
    assert page.refused == []


def test_what_is_typed_and_is_there_already_changes_nothing(page: Page) -> None:
    field = page.add("number", "Radius (mm)", 25.0, min=5.0, max=45.0)
    page.finish(field, "25.0")
    assert page.heard == page.refused == []


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("453", "Radius (mm) must be 5 to 45, not 453"),
        ("1e9", "Radius (mm) must be 5 to 45, not 1000000000"),
        ("4.99", "Radius (mm) must be 5 to 45, not 4.99"),
        ("abc", "Radius (mm): expected a number such as 2.5, not 'abc'"),
        ("", "Radius (mm): expected a number such as 2.5, not ''"),
    ],
)
def test_a_refused_text_leaves_the_field_and_tells_nobody_else(
    page: Page, text: str, reason: str
) -> None:
    field = page.add("number", "Radius (mm)", 25.0, min=5.0, max=45.0)
    page.finish(field, text)
    assert field.value == 25.0
    assert page.heard == []
    assert page.refused == [reason]


def test_a_field_for_whole_numbers_takes_no_others(page: Page) -> None:
    field = page.add("number", "Seed", 0, min=0, max=100)
    page.finish(field, "2.5")
    assert page.refused == ["Seed: expected a whole number, not 2.5"]
    page.finish(field, "3.0")
    assert (field.value, type(field.value)) == (3, int)


def test_one_component_of_a_vector_is_taken_and_the_others_stay(page: Page) -> None:
    field = page.add("vector3", "Shift (mm)", (1.0, 2.0, 3.0))
    page.finish(field, "-7", part=1)
    assert field.value == (1.0, -7.0, 3.0)
    page.finish(field, "x", part=2)
    assert field.value == (1.0, -7.0, 3.0)
    assert page.heard == [(CLIENT, True, (1.0, -7.0, 3.0))]
    assert page.refused == ["Shift (mm): expected a number such as 2.5, not 'x'"]


def test_a_text_is_taken_as_it_is_and_a_slider_keeps_its_ends(page: Page) -> None:
    name = page.add("text", "Name", "old")
    page.finish(name, "1e9 <b>")
    assert name.value == "1e9 <b>"
    slider = page.add("slider", "Motion (%)", 0.0, 100.0, 0.1, 50.0)
    page.finish(slider, "150")
    assert slider.value == 50.0
    assert page.refused == ["Motion (%) must be 0 to 100, not 150"]


def test_a_field_that_a_job_has_closed_takes_nothing_and_says_so(page: Page) -> None:
    field = page.add("number", "Radius (mm)", 25.0, min=5.0, max=45.0)
    field.disabled = True
    page.finish(field, "30")
    assert field.value == 25.0
    assert page.refused == ["Radius (mm) cannot be changed now: wait for the job or cancel it"]


@pytest.mark.parametrize(
    "mail",
    ["", "{}", "[]", "null", '{"field": "other", "part": 0, "text": "1"}', "[" * 100_000,
     '{"field": [], "part": 0, "text": "1"}'],
)  # fmt: skip
def test_a_message_that_no_page_of_ours_sends_is_refused(page: Page, mail: str) -> None:
    page.send(mail)
    (reason,) = page.refused
    assert reason.endswith("load the page again")


def test_text_and_part_of_other_types_are_refused(page: Page) -> None:
    field = page.add("number", "Radius (mm)", 25.0)
    uuid = f"uuid-{id(field._handle)}"
    for part, text in (("0", "1"), (0, 1), (0, None), (1.5, "1")):
        page.send(json.dumps({"field": uuid, "part": part, "text": text}))
    assert len(page.refused) == 4
    assert field.value == 25.0


def test_numbers_show_what_they_hold_and_whole_ones_stay_whole(page: Page) -> None:
    fine, whole = page.add("number", "a", 2.65), page.add("number", "b", 3)
    assert fine.precision == DECIMALS
    assert not hasattr(whole, "precision")


def test_a_field_is_viser_s_own_in_all_else() -> None:
    handle = FakeHandle("number", "a", value=1.0, removed=False)
    field = Field(handle, "a")
    field.value, field.disabled = 2.0, True
    assert (handle.value, handle.disabled) == (2.0, True)
    field.remove()
    assert handle.removed


# -- the seam: what fields know of viser -----------------------------------------------------------


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_fields_of_viser_have_what_is_read_of_them() -> None:
    gateway = ViewerGateway()
    try:
        told: list[Any] = []
        gui = gateway.server.gui
        fields = Fields(gui, lambda error, event: told.append(str(error)))
        number = fields.add_number("n", 1.5, min=0.0, max=3.0, step=0.5)
        whole = fields.add_number("w", 1, min=0, max=3)
        free = fields.add_number("f", 1.5)
        slider = fields.add_slider("s", 0.0, 10.0, 0.5, 5.0)
        vector = fields.add_vector3("v", (1.0, 2.0, 3.0), step=1.0)
        text = fields.add_text("t", "a")
        assert len({uuid_of(f._handle) for f in (number, whole, free, slider, vector, text)}) == 6
        for field, typed in ((number, "2"), (whole, "2"), (free, "2"), (slider, "2")):
            assert field.take(typed, 0)
            assert field.value == 2
            assert not field.take(typed, 0)
        assert vector.take("9.25", 2)
        assert vector.value == (1.0, 2.0, 9.25)
        assert text.take("b", 0)
        with pytest.raises(InvalidInputError, match="n must be 0 to 3, not 4"):
            number.take("4", 0)
        with pytest.raises(InvalidInputError, match="s must be 0 to 10, not 11"):
            slider.take("11", 0)
        assert gui_value(gui, number) == 2.0
        with pytest.raises(InvalidInputError, match="whole number"):
            whole.take("1.5", 0)
    finally:
        gateway.close()


def gui_value(gui: Any, field: Field) -> Any:
    """Return what viser itself holds under the name by which the page calls a field."""
    return gui._gui_input_handle_from_uuid[uuid_of(field._handle)].value


def test_what_listens_hears_of_viser_s_own_changes_too() -> None:
    handle = FakeHandle("number", "a", value=1.0)
    field, heard = Field(handle, "a"), []

    @field.on_update
    async def _(event: Any) -> None:
        heard.append(event.client)

    handle.happen(CLIENT)  # an arrow beside the number, or a drag
    asyncio.run(field.notify_listeners("typed"))
    assert heard == [CLIENT, "typed"]


def test_the_icons_of_viser_are_read_from_an_archive_that_stays_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    genuine = {name: svg_from_icon(name) for name in ("check", "plus", "trash")}
    gateway = ViewerGateway()
    monkeypatch.setattr(zipfile, "ZipFile", None)  # it cannot be opened again
    try:
        gui = gateway.server.gui
        button = gui.add_button("Do", icon="check")
        tabs = gui.add_tab_group()
        tabs.add_tab("One", "plus")
        held = [button._impl.props._icon_html, *tabs._impl.props._tab_icons_html]
        button.icon = "trash"
        assert [*held, button._impl.props._icon_html] == list(genuine.values())
    finally:
        gateway.close()


def test_why_a_text_was_refused_stands_below_its_field_until_something_is_taken(
    page: Page,
) -> None:
    radius = page.add("number", "Radius (mm)", 25.0, min=5.0, max=45.0, hint="Of the region")
    seed = page.add("number", "Seed", 0, min=0, max=100)
    below = {field: page.gui.handles[page.gui.handles.index(field._handle) + 1]
             for field in (radius, seed)}  # fmt: skip
    page.finish(radius, "453")
    assert "Radius (mm) must be 5 to 45, not 453" in below[radius].content
    assert "Of the region. 5 to 45 mm." in below[radius].content  # the hint stays
    page.finish(seed, "<b>")
    assert "r-wrong" not in below[radius].content  # one at a time
    assert "&lt;b&gt;" in below[seed].content
    page.finish(seed, "7")
    assert "r-wrong" not in below[seed].content
    page.finish(seed, "x")
    seed.value = 7  # written again as it is: the reason still holds
    assert "r-wrong" in below[seed].content
    seed.value = 8  # by somebody else
    assert "r-wrong" not in below[seed].content
    page.finish(seed, "x")
    seed.remove()
    assert below[seed].removed
