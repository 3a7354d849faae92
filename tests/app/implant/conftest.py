"""The demo session, and a workbench on it."""

import pytest

from rona_core.compose import new_workbench


@pytest.fixture
def bench(demo):
    made = new_workbench(demo)
    yield made
    made.close()
