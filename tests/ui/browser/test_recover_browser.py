"""A program that is killed in the middle of work, and what the page offers afterwards."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.ui.browser_driver import (
    REPOSITORY,
    TOKEN,
    Surgeon,
    _answers,
    free_port,
    surgeon_at,
    wait_for,
)

pytestmark = [pytest.mark.browser, pytest.mark.slow]
NAME = "Bone <b>9</b> & co"  # would be markup if it were not escaped
POST = """async ([path, body]) => (await fetch('/api/v1' + path, {method: 'POST',
  headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)})).json()"""


class Program:
    """`rona serve` on one port; it can be killed, with all that it started, and started anew."""

    def __init__(self, sessions: Path) -> None:
        self.sessions, self.port = sessions, free_port()
        self.address = f"http://127.0.0.1:{self.port}/"
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "rona_ui", "serve", "--no-open", "--pace", "0"]
        command += ["--port", str(self.port), "--sessions", str(self.sessions)]
        environment = {**os.environ, "RONA_TOKEN": TOKEN, "OMP_NUM_THREADS": "1"}
        self.log = (self.sessions / "server.log").open("ab")
        self.process = subprocess.Popen(
            command, cwd=REPOSITORY, env=environment, stdout=self.log, stderr=self.log,
            start_new_session=True,
        )  # fmt: skip
        wait_for(lambda: _answers(self.address), "the server")

    def kill(self) -> None:
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(20)
        self.log.close()


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    running = Program(tmp_path_factory.mktemp("sessions"))
    yield running
    running.kill()


@pytest.fixture(scope="module")
def surgeon(
    program: Program, browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Surgeon]:
    address, pictures = f"{program.address}?token={TOKEN}", tmp_path_factory.mktemp("pictures")
    with surgeon_at(browser, address, pictures) as surgeon:
        yield surgeon


def post(surgeon: Surgeon, path: str, body: Any = None) -> Any:
    return surgeon.page.evaluate(POST, [path, body or {}])


def current(surgeon: Surgeon) -> Any:
    return surgeon.ask("/sessions/current")


def open_folder(surgeon: Surgeon) -> None:
    """Unfold the part of the left dock that is about the session as a whole."""
    if not surgeon.button("New session").is_visible():
        surgeon.frame.get_by_text("Session", exact=True).click()
    surgeon.button("New session").wait_for()


def test_work_that_was_killed_is_offered_and_comes_back_whole(
    surgeon: Surgeon, program: Program
) -> None:
    page = surgeon.page
    assert not page.locator("#lost").is_visible()
    open_folder(surgeon)
    surgeon.button("New session").click()  # an untouched copy of the demo is nothing to ask about
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
    assert "recovered, not saved" in surgeon.frame.locator(".r-head").inner_text()
    surgeon.wait_state("Pointer", "done")
    surgeon.picture("recovered")


def test_work_that_is_not_saved_does_not_go_out_of_sight_without_a_question(
    surgeon: Surgeon, program: Program
) -> None:
    page, frame = surgeon.page, surgeon.frame
    key = current(surgeon)["id"]

    page.locator("#demo").click()
    page.locator("#leave").wait_for()
    assert NAME in page.locator("#leavetitle").inner_text()
    surgeon.picture("leave_demo")
    page.locator("#leavecancel").click()
    assert current(surgeon)["id"] == key
    page.locator("#demo").click()
    page.locator("#leavekeep").click()
    wait_for(lambda: current(surgeon)["id"] != key, "the demo")
    assert [s["id"] for s in surgeon.ask("/sessions")["sessions"]][-2] == key

    open_folder(surgeon)  # back to it
    chosen = surgeon.field("Open sessions")
    wait_for(lambda: chosen.input_value() == "3: demo seed 0", "the list to follow")
    chosen.click()
    surgeon.picture("open_sessions")
    frame.get_by_role("option", name=NAME).click()
    wait_for(lambda: current(surgeon)["id"] == key, "the session before")

    surgeon.button("New session").click()
    frame.get_by_text("has unsaved changes").wait_for()
    surgeon.picture("leave_new")
    surgeon.button("Cancel").last.click()
    frame.get_by_text("has unsaved changes").wait_for(state="hidden")
    assert current(surgeon)["id"] == key
    surgeon.button("New session").click()
    surgeon.button("Save first").click()
    wait_for(lambda: current(surgeon)["id"] != key, "the new session")
    assert len(list(program.sessions.glob("Bone*.rona"))) == 1

    post(surgeon, "/sessions/current/commands/SetSeed", {"seed": 5})
    closing = current(surgeon)["id"]
    wait_for(lambda: "not saved" in frame.locator(".r-head").inner_text(), "the head")
    surgeon.button("Close session").click()
    frame.get_by_text("If you close it now, the changes are lost").wait_for()
    surgeon.picture("close")
    surgeon.button("Close without saving").click()
    wait_for(lambda: current(surgeon)["id"] != closing, "another session")
    assert closing not in [s["id"] for s in surgeon.ask("/sessions")["sessions"]]
    assert surgeon.errors == []
