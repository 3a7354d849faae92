"""Every control of the docks says on hover what it does, in the page as well as in viser."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from rona_ui.panels.layout.docks import STEP_PANELS, TAB_PANELS, Docks
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.viewer.fields import HINTS, OTHERS, TYPED, Fields, full_hint
from rona_ui.viewer.gateway import ViewerGateway, uuid_of
from tests.ui.layout.test_one_verdict import NOTHING

STEP = re.compile(r"Step \d+: ")  # a button over a row of the list, whose title is its reason
LIMITS = re.compile(r"\.? ?-?[\d.e+]+ to -?[\d.e+]+( [^.]*)?\.$")  # of a number: no words
SHORTEST = 6  # characters
HIDDEN = ("Typed", "Page")  # fields that the page writes into
LATER = {"Pose", "Roll", "A-scan"}  # added once there is an image


class Recorded:
    """A gui of viser that remembers the controls that were added, and their hints."""

    def __init__(self, gui: Any) -> None:
        self._gui = gui
        self.controls: list[tuple[str, str, str | None, Any]] = []
        self.html: list[str] = []

    def __getattr__(self, name: str) -> Any:
        made = getattr(self._gui, name)

        def add(label: str, *rest: Any, **options: Any) -> Any:
            handle = made(label, *rest, **options)
            self.controls.append((name, label, options.get("hint"), handle))
            return handle

        def html(content: str, **options: Any) -> Any:
            self.html.append(content)
            return made(content, **options)

        return add if name in (*TYPED, *OTHERS) else html if name == "add_html" else made


@pytest.fixture(scope="module")
def docks() -> Iterator[Recorded]:
    gateway = ViewerGateway()
    gui = Recorded(gateway.server.gui)
    docks = Docks(Fields(gui, lambda error, event: None), NOTHING, ErrorBoundary())
    for step in STEP_PANELS:
        docks.build(step, TAB_PANELS)
    yield gui
    gateway.close()


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_every_control_has_a_hint_that_says_more_than_its_label(docks: Recorded) -> None:
    assert len(docks.controls) > 150
    lacking = [
        f"{kind.removeprefix('add_')} {label!r}: {hint!r}"
        for kind, label, hint, _ in docks.controls
        if label not in HIDDEN and not STEP.match(label)
        and (len(said := LIMITS.sub("", hint or "")) < SHORTEST or said.lower() == label.lower())
    ]  # fmt: skip
    assert lacking == []


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_no_hint_is_kept_for_a_control_that_is_gone(docks: Recorded) -> None:
    used = {
        label
        for _, label, hint, _ in docks.controls
        if label in HINTS and (hint or "").startswith(HINTS[label])
    }
    assert set(HINTS) - used - LATER == set()


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_the_page_is_given_the_hint_of_every_control(docks: Recorded) -> None:
    told = "".join(docks.html)
    for _, label, hint, handle in docks.controls:
        if hint:
            assert f'data-hint-for="{uuid_of(handle)}"' in told, label


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_a_number_with_limits_shows_them_with_its_unit(docks: Recorded) -> None:
    for label, limits in (
        ("Region radius (mm)", "5 to 45 mm."),
        ("Pivot cone (deg)", "5 to 45 deg."),
        ("Seed", "0 to 2147483647."),
        ("Tolerance (mm)", "0.1 to 5 mm."),
    ):
        (hint,) = [hint for _, named, hint, _ in docks.controls if named == label]
        assert hint.endswith(limits)
    assert full_hint("Between A-scans", "Pitch (mm)", 0.2, 10.0) == "Between A-scans. 0.2 to 10 mm."
    assert full_hint("Along x, y, z", "Shift (mm)") == "Along x, y, z"
    assert full_hint(None, "Name") is None
