"""How much a session file may hold: the limits, what is counted, and who is refused by name."""

import json
import zipfile
from io import BytesIO

import numpy as np
import pytest

from rona_core.errors import SessionFormatError
from rona_core.session import files, members
from rona_core.session.codec import encode
from rona_core.session.document import Session
from rona_core.session.files import load_session, session_bytes, session_from_bytes
from rona_core.session.members import read_members, require_room, used_bytes
from tests.core.session.test_session_files import session

MB = 1024**2


def test_limits_are_those_of_the_documents():
    assert members.MAX_STORED_BYTES == 192 * MB
    assert members.MAX_USED_BYTES == 384 * MB
    assert members.MAX_FILE_BYTES == 256 * MB
    assert members.MAX_CAPTURE_BYTES == 64 * MB
    assert members.MAX_JSON_BYTES == {"manifest.json": 12 * MB, "commands.jsonl": 24 * MB}


def test_arrays_in_use_are_counted_each_time_and_twice_where_they_are_unpacked_again():
    arrays = {"a": np.zeros(10), "b": np.zeros(3, dtype=np.int32)}
    one, other = {"array": "a"}, {"array": "b"}
    assert used_bytes({}, arrays) == 0
    assert used_bytes([one, {"deeper": [other, one]}], arrays) == 80 + 12 + 80
    assert used_bytes({**one, "step": 1}, arrays) == 160
    assert used_bytes([{"array": "missing"}, {"array": 3}, "a"], arrays) == 0


def test_a_session_uses_what_its_arrays_take():
    arrays: dict = {}
    document = encode(session(), "session", arrays)
    assert used_bytes(document, arrays) >= sum(array.nbytes for array in arrays.values())


@pytest.mark.parametrize(
    ("stored", "used", "texts"),
    [
        (192 * MB, 384 * MB, {"manifest.json": 12 * MB}),
        (0, 0, {"commands.jsonl": 24 * MB}),
    ],
)
def test_what_just_fits_is_taken_and_one_byte_more_is_not(stored, used, texts):
    require_room(stored, used, texts, "it")
    for more in (
        (192 * MB + 1, used, texts),
        (stored, 384 * MB + 1, texts),
        (stored, used, {name: size + 1 for name, size in texts.items()}),
    ):
        with pytest.raises(SessionFormatError, match="it "):
            require_room(*more, "it")


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "large.rona"
    data = session_bytes(session())
    path.write_bytes(data)
    monkeypatch.setattr(files, "MAX_FILE_BYTES", len(data))
    load_session(path)
    monkeypatch.setattr(files, "MAX_FILE_BYTES", len(data) - 1)
    monkeypatch.setattr(files, "session_from_bytes", None)  # is not reached
    with pytest.raises(SessionFormatError, match=r"large\.rona has 0 MB: a session file has at"):
        load_session(path)


def test_a_session_that_uses_more_than_there_may_be_is_refused_when_it_is_read(monkeypatch):
    data = session_bytes(session())
    monkeypatch.setattr(members, "MAX_USED_BYTES", 10)
    with pytest.raises(SessionFormatError, match="arrays in use"):
        session_from_bytes(data)


def test_arrays_of_a_file_cannot_be_written_to():
    arrays = read_members(session_bytes(session()), "it").arrays
    assert arrays
    assert not any(array.flags.writeable for array in arrays.values())


def test_members_have_one_time_and_plain_rights():
    """The same session gives the same bytes, and a file that everybody may read."""
    with zipfile.ZipFile(BytesIO(session_bytes(session()))) as archive:
        for info in archive.infolist():
            assert info.date_time == (1980, 1, 1, 0, 0, 0)
            assert info.external_attr >> 16 == 0o644


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda held: held.pop("name"), "Session lacks name"),
        (lambda held: held.update(more=1), "Session does not know more"),
        (lambda held: (held.pop("name"), held.update(more=1)), "lacks name and does not know more"),
    ],
)
def test_a_field_too_few_or_too_many_is_named(change, words):
    data = session_bytes(Session(name="n"))
    with zipfile.ZipFile(BytesIO(data)) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    manifest = json.loads(held["manifest.json"])
    change(manifest["session"])
    held["manifest.json"] = json.dumps(manifest).encode()
    out = BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in held.items():
            archive.writestr(name, content)
    with pytest.raises(SessionFormatError, match=words) as caught:
        session_from_bytes(out.getvalue())
    assert ("lacks" in str(caught.value)) is ("lacks" in words)
