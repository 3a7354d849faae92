"""A program that is killed in the middle of work, and what the page offers afterwards."""

from collections.abc import Iterator
from typing import Any

import pytest

from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session
from tests.helpers.ui.browser_driver import TOKEN, Surgeon, surgeon_at, wait_for
from tests.helpers.ui.program import Program

pytestmark = [pytest.mark.browser, pytest.mark.slow]
NAME = "Bone <b>9</b> & co"  # would be markup if it were not escaped
POST = """async ([path, body]) => (await fetch('/api/v1' + path, {method: 'POST',
  headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)})).json()"""
DELETE = "async (path) => { await fetch('/api/v1' + path, {method: 'DELETE'}); }"
CHANGES = "async () => (await import('/static/page/base.js')).program.state.session.changes"
OLDER = """async () => {
  const { program } = await import('/static/page/base.js');
  program.state = { ...program.state, session: { ...program.state.session, changes: false } };
}"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    running = Program(tmp_path_factory.mktemp("sessions"))
    yield running
    running.kill()


@pytest.fixture(scope="module")
def surgeon(
    program: Program, browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Surgeon]:
    pictures = tmp_path_factory.mktemp("pictures")
    address = f"{program.address}session?token={TOKEN}"
    with surgeon_at(browser, address, pictures) as surgeon:
        yield surgeon


def post(surgeon: Surgeon, path: str, body: Any = None) -> Any:
    return surgeon.page.evaluate(POST, [path, body or {}])


def current(surgeon: Surgeon) -> Any:
    return surgeon.ask("/sessions/current")


def test_work_that_was_killed_is_offered_and_comes_back_whole(
    surgeon: Surgeon, program: Program
) -> None:
    page = surgeon.page
    assert not page.locator("#lost").is_visible()
    surgeon.menu("sessionbutton", "New session")  # an untouched demo is nothing to ask about
    wait_for(lambda: current(surgeon)["name"] == "untitled", "the new session")
    surgeon.open_step("Pointer")
    surgeon.button("Pivot and calibrate").click()
    surgeon.wait_state("Pointer", "done")
    post(surgeon, "/sessions/current/commands/RenameSession", {"name": NAME})
    before = current(surgeon)
    program.kill()  # at once after the answer
    program.start()

    page.locator("#lost").wait_for()  # the page has noticed by itself
    item = page.locator("#lostlist li")
    assert item.count() == 1
    words = item.inner_text()
    assert NAME in words
    assert "2 of 10 steps done: Set-up, Pointer" in words
    assert "MB" in words
    assert "today" in words
    surgeon.picture("recover_offer")
    assert page.locator("#stop").is_enabled()

    item.get_by_role("button", name="Discard").click()  # asks again before it is gone
    surgeon.picture("recover_discard")
    item.get_by_role("button", name="Keep").click()
    page.locator("#lostlater").click()
    assert not page.locator("#lost").is_visible()
    page.locator("#lostbutton").click()
    page.locator("#lostlist li").get_by_role("button", name="Recover").click()
    page.locator("#lost").wait_for(state="hidden")
    after = current(surgeon)
    same = ("name", "revision", "captures", "seed", "setup")
    assert {key: after[key] for key in same} == {key: before[key] for key in same}
    assert (after["saved"], after["recovered"], after["copy"]) == (False, True, "kept")
    assert surgeon.ask("/recoverable") == {"recoverable": []}
    assert page.locator("#saved").inner_text() == "● recovered, not saved"
    surgeon.come()
    assert "recovered, not saved" in surgeon.saved()
    surgeon.wait_state("Pointer", "done")
    surgeon.picture("recovered")


def test_of_a_damaged_file_the_last_good_copy_can_be_opened(
    surgeon: Surgeon, program: Program
) -> None:
    page = surgeon.page
    path = program.sessions / "hurt.rona"
    save_session(Session(name="older copy"), path)
    save_session(Session(name="newer"), path)
    path.write_bytes(path.read_bytes()[:-100])
    before = current(surgeon)["id"]
    surgeon.menu("sessionbutton", "Open…")
    page.locator("#homefiles .card").filter(has_text="hurt").click()
    page.locator("#leavekeep").click()  # the present session is not saved
    page.locator("#leavetext").get_by_text("the file is damaged: its end is missing").wait_for()
    surgeon.picture("damaged_file")
    page.locator("#leavecancel").click()
    assert page.locator("#homefiles").is_visible()
    assert current(surgeon)["id"] == before
    page.locator("#homefiles .card").filter(has_text="hurt").click()
    page.locator("#leavekeep").click()
    page.locator("#leavekeep").get_by_text("Open the last good copy").click()
    wait_for(lambda: current(surgeon)["name"] == "older copy", "the copy")
    assert not current(surgeon)["saved"]
    page.evaluate(DELETE, f"/sessions/{current(surgeon)['id']}")
    post(surgeon, f"/sessions/{before}/current")
    surgeon.come()
    path.unlink()


def test_work_that_is_not_saved_does_not_go_out_of_sight_without_a_question(
    surgeon: Surgeon, program: Program
) -> None:
    page = surgeon.page
    key = current(surgeon)["id"]

    surgeon.menu("sessionbutton", "Demo")
    page.locator("#leave").wait_for()
    assert NAME in page.locator("#leavetitle").inner_text()
    surgeon.picture("leave_demo")
    page.locator("#leavecancel").click()
    assert current(surgeon)["id"] == key
    surgeon.menu("sessionbutton", "Demo")
    page.locator("#leavekeep").click()
    wait_for(lambda: current(surgeon)["id"] != key, "the demo")
    assert [s["id"] for s in surgeon.ask("/sessions")["sessions"]][-2] == key

    surgeon.menu("sessionbutton")  # back to it
    entries = page.locator("#sessionbuttonmenu .entry")
    wait_for(lambda: entries.filter(has_text="demo seed 0").count() == 2, "the list to follow")
    surgeon.picture("open_sessions")
    entries.filter(has_text=NAME).first.click()
    wait_for(lambda: current(surgeon)["id"] == key, "the session before")

    surgeon.menu("sessionbutton", "New session")
    page.locator("#leavetext").get_by_text("has unsaved changes").wait_for()
    surgeon.picture("leave_new")
    page.keyboard.press("Escape")
    page.locator("#leave").wait_for(state="hidden")
    assert current(surgeon)["id"] == key
    surgeon.menu("sessionbutton", "New session")
    page.locator("#leavesave").click()
    wait_for(lambda: current(surgeon)["id"] != key, "the new session")
    assert len(list(program.sessions.glob("Bone*.rona"))) == 1

    post(surgeon, "/sessions/current/commands/SetSeed", {"seed": 5})
    closing = current(surgeon)["id"]
    wait_for(lambda: page.evaluate(CHANGES), "what streams in")
    page.evaluate(OLDER)  # the page has not heard of it yet: it must ask all the same
    surgeon.menu("sessionbutton", "Close session")
    page.locator("#leavetext").get_by_text("the changes are lost").wait_for()
    surgeon.picture("close")
    page.locator("#leavelose").click()
    wait_for(lambda: current(surgeon)["id"] != closing, "another session")
    assert closing not in [s["id"] for s in surgeon.ask("/sessions")["sessions"]]
    assert surgeon.errors == []


def test_a_file_that_another_program_has_changed_is_not_written_over_without_a_question(
    surgeon: Surgeon, program: Program
) -> None:
    page = surgeon.page
    surgeon.menu("sessionbutton", "New session")
    if page.locator("#leave").is_visible():
        page.locator("#leavekeep").click()
    wait_for(lambda: current(surgeon)["name"] == "untitled", "the new session")
    post(surgeon, "/sessions/current/commands/RenameSession", {"name": "shared"})
    path = program.sessions / "shared.rona"
    wait_for(lambda: page.locator("#save").is_enabled(), "the view of it")
    page.locator("#save").click()
    wait_for(path.is_file, "the file")

    def meet() -> None:
        save_session(Session(name="theirs"), path)
        post(surgeon, "/sessions/current/commands/SetSeed", {"seed": 5})
        page.locator("#save").click()
        page.locator("#leavetitle").get_by_text("has changed").wait_for()

    meet()
    surgeon.picture("file_changed")
    page.locator("#leavecancel").click()
    assert load_session(path).name == "theirs"
    assert current(surgeon)["file_state"] == "changed"
    meet()
    page.locator("#leavesave").click()
    page.locator("#namingdo").click()
    wait_for((program.sessions / "shared 2.rona").is_file, "the other file")
    assert load_session(path).name == "theirs"

    save_session(Session(name="theirs"), program.sessions / "shared 2.rona")
    page.locator("#save").click()
    page.locator("#leavelose").click()  # overwrite
    wait_for(lambda: current(surgeon)["saved"], "the saved session")
    assert load_session(program.sessions / "shared 2.rona").name == "shared"
    save_session(Session(name="theirs"), program.sessions / "shared 2.rona")
    page.locator("#save").click()
    page.locator("#leavekeep").click()  # reload
    wait_for(lambda: current(surgeon)["name"] == "theirs", "what is in the file")
    assert current(surgeon)["saved"]
    assert surgeon.errors == []
