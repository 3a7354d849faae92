"""The demo session, and a workbench on it."""

import pytest

from rona_core.compose import new_workbench
from rona_core.session.files import load_session
from rona_ui.resources import demo_session


@pytest.fixture(scope="module")
def demo():
    return load_session(demo_session())


@pytest.fixture
def bench(demo):
    made = new_workbench(demo)
    yield made
    made.close()
