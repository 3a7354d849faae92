"""A browser for each file (its event loop would be in the way of others), one server for all."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.ui.browser_driver import (
    PICTURES,
    REPOSITORY,
    Surgeon,
    running_browser,
    running_server,
    surgeon_at,
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as started:
        yield started


@pytest.fixture(scope="session")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder for pictures: that of the user guide if they are taken for it."""
    if not PICTURES:
        return tmp_path_factory.mktemp("pictures")
    folder = REPOSITORY / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server whose robot moves slowly enough to be stopped on its way."""
    with running_server(tmp_path_factory.mktemp("sessions"), pace=2.0) as address:
        yield address


@pytest.fixture(scope="module")
def surgeon(server: str, browser: Any, pictures: Path) -> Iterator[Surgeon]:
    """A new page of the shared server, on the demo session as it is on file."""
    with surgeon_at(browser, server, pictures) as surgeon:
        surgeon.open_demo()
        surgeon.close_others()  # a server has a limit to those that are open
        yield surgeon
