import pickle

import pytest

from rona_core import errors
from rona_core.errors import InvalidInputError, RonaError

KINDS = [
    kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, RonaError)
]
CODES = {
    "rona_error", "invalid_input", "degenerate_geometry", "not_reachable", "device_error",
    "step_blocked", "stale_result", "not_found", "session_format", "cancelled", "name_taken",
    "file_changed", "storage",
}  # fmt: skip


def test_the_codes_are_those_that_clients_know():
    assert {kind.code for kind in KINDS} == CODES
    assert len(KINDS) == len(CODES)


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_carries_message_and_data_also_between_processes(kind):
    error = kind("expected 3, got 2", step="pivot", count=2)
    for each in (error, pickle.loads(pickle.dumps(error))):
        assert isinstance(each, kind)
        assert str(each) == "expected 3, got 2"
        assert each.data == {"step": "pivot", "count": 2}


def test_wrong_input_is_also_a_value_error():
    assert issubclass(InvalidInputError, ValueError)
