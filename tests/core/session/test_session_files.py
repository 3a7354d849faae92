"""Session files: the same document gives the same bytes, and nothing foreign gets in."""

import hashlib
import io
import json
import os
import subprocess
import sys
import threading
import zipfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rona_core.devices.samples import ToolTrack
from rona_core.errors import NotFoundError, SessionFormatError, StorageError
from rona_core.geometry.pose import Pose, Poses
from rona_core.session import files, members
from rona_core.session.captures import PointerCapture
from rona_core.session.codec import STEP, decode, digest, encode
from rona_core.session.document import Captures, LogEntry, Session
from rona_core.session.files import (
    load_session,
    lock_file,
    save_session,
    session_bytes,
    session_from_bytes,
)
from rona_ui.resources import demo_session

WHOLE = Path(__file__).resolve().parents[2] / "sessions" / "whole.rona"


def capture(n: int = 60) -> PointerCapture:
    rng = np.random.default_rng(5)
    poses = Poses.stack(
        [Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3)) for _ in range(n)]
    )
    track = ToolTrack(
        "pointer6d", np.arange(n), np.arange(n) / 60.0, poses, rng.random(n), n_frames=n
    )
    return PointerCapture(1, "digest of the setup", "pointer6d", track)


def session() -> Session:
    log = (LogEntry(1, "SetSeed", {"seed": 4}, "2026-01-01T00:00:00+00:00"),)
    taken = capture()
    return Session(name="ä <b>", captures=Captures(pointer=taken), archive=(taken,), log=log)


def rewritten(data: bytes, change) -> bytes:
    """The same zip with its members changed."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    change(members)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def names_in(data: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.namelist()


def with_manifest(data: bytes, change) -> bytes:
    def edit(members):
        manifest = json.loads(members["manifest.json"])
        change(manifest)
        members["manifest.json"] = json.dumps(manifest).encode()

    return rewritten(data, edit)


def test_saving_and_loading_gives_the_same_document_and_the_same_bytes(tmp_path):
    original = session()
    path = save_session(original, tmp_path / "one.rona")
    back = load_session(path)
    assert digest(back) == digest(original)
    assert session_bytes(back) == path.read_bytes() == session_bytes(original)


def test_a_capture_that_is_in_the_archive_too_is_there_once():
    original = session()
    taken, other = original.archive[0], replace(capture(30), ordinal=2)
    original = replace(
        original,
        captures=Captures(pointer=other, surface=(taken, other), path=replace(taken, partial=True)),
        archive=(taken, other),
    )
    back = session_from_bytes(session_bytes(original))
    first, second = back.archive
    assert back.captures.pointer is second
    assert back.captures.surface == (first, second)
    assert back.captures.path.partial
    assert back.captures.path is not first
    assert digest(back) == digest(original)


def test_a_capture_of_the_archive_in_a_place_of_others_is_refused():
    def exchange(manifest):
        manifest["session"]["captures"]["tool"] = manifest["session"]["captures"]["pointer"]

    with pytest.raises(SessionFormatError, match="session/captures/tool"):
        session_from_bytes(with_manifest(session_bytes(session()), exchange))


def test_a_file_of_before_packing_loads(monkeypatch):
    original = session()
    assert any(name.startswith("packed/") for name in names_in(session_bytes(original)))
    monkeypatch.setattr(files, "pack", lambda array: None)
    plain = session_bytes(original)
    assert not any(name.startswith("packed/") for name in names_in(plain))
    assert digest(session_from_bytes(plain)) == digest(original)
    older = with_manifest(plain, lambda manifest: manifest.pop("packed"))
    assert digest(session_from_bytes(older)) == digest(original)


def test_the_last_good_file_is_kept(tmp_path):
    path = tmp_path / "one.rona"
    save_session(session(), path)
    save_session(replace(session(), name="second"), path)
    assert load_session(path).name == "second"
    assert session_from_bytes((tmp_path / "one.rona.bak").read_bytes()).name == "ä <b>"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.rona", "one.rona.bak"]


def flipped(data):
    place = len(data) // 2
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


DAMAGE = {
    "truncated": (lambda data: data[:-100], "its end is missing"),
    "a flipped bit": (flipped, ""),
    "empty": (lambda data: b"", "it is empty"),
    "no zip": (lambda data: b"not a session" * 20, "it is no zip file"),
}


@pytest.mark.parametrize(("damage", "why"), DAMAGE.values(), ids=list(DAMAGE))
def test_a_damaged_file_says_so_and_names_its_last_good_copy(tmp_path, damage, why):
    path = tmp_path / "one.rona"
    save_session(session(), path)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(SessionFormatError) as alone:
        load_session(path)
    assert str(alone.value).startswith(f"one.rona: the file is damaged: {why}")
    assert ".bak" not in str(alone.value)
    assert "backup" not in alone.value.data
    backup = tmp_path / "one.rona.bak"
    backup.write_bytes(session_bytes(session()))
    with pytest.raises(SessionFormatError, match=r"Its last good copy is one\.rona\.bak") as copied:
        load_session(path)
    assert copied.value.data["backup"] == "one.rona.bak"
    backup.write_bytes(damage(backup.read_bytes()))  # no good one
    with pytest.raises(SessionFormatError) as neither:
        load_session(path)
    assert "backup" not in neither.value.data


def test_every_flipped_bit_of_a_file_is_found_or_does_no_harm():
    made = session()  # another one has another id
    data, original = session_bytes(made), digest(made)
    for place in range(0, len(data), 37):
        changed = data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        with suppress(SessionFormatError):
            assert digest(session_from_bytes(changed)) == original


def test_a_crash_while_writing_leaves_the_old_file(tmp_path, monkeypatch):
    path = save_session(session(), tmp_path / "one.rona")
    before = path.read_bytes()

    def crash(_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(StorageError, match=r"one.rona: disk full; try another folder"):
        save_session(replace(session(), name="second"), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["one.rona"]


def test_every_flipped_byte_is_noticed():
    data = session_bytes(session())
    reference = digest(session_from_bytes(data))
    rng = np.random.default_rng(0)
    for position in rng.choice(len(data), 150, replace=False):
        spoiled = bytearray(data)
        spoiled[position] ^= 0x10
        try:
            back = session_from_bytes(bytes(spoiled))
        except SessionFormatError:
            continue
        assert digest(back) == reference, f"byte {position} changed the document unnoticed"


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_refused(share):
    data = session_bytes(session())
    with pytest.raises(SessionFormatError):
        session_from_bytes(data[: int(share * len(data))])


def test_a_newer_schema_is_refused_and_says_so():
    data = with_manifest(session_bytes(session()), lambda m: m.update(schema=999))
    with pytest.raises(SessionFormatError, match="newer RONA"):
        session_from_bytes(data)


@pytest.mark.parametrize("schema", [None, 0, -1, "1", 1.5, True, members.SCHEMA - 1])
def test_a_strange_schema_is_refused(schema):
    data = with_manifest(session_bytes(session()), lambda m: m.update(schema=schema))
    with pytest.raises(SessionFormatError, match="schema"):
        session_from_bytes(data)


@pytest.mark.parametrize(
    "name", ["../evil.npy", "/etc/passwd", "arrays/../../x.npy", "arrays/x.pkl", "notes.txt"]
)
def test_foreign_members_are_refused_before_anything_is_read(name):
    data = rewritten(session_bytes(session()), lambda members: members.update({name: b"x"}))
    with pytest.raises(SessionFormatError, match="not a session file"):
        session_from_bytes(data)


@pytest.mark.filterwarnings("ignore:Duplicate name:UserWarning")
def test_a_name_that_stands_twice_is_refused():
    out = io.BytesIO(session_bytes(session()))
    with zipfile.ZipFile(out, "a") as archive:
        archive.writestr("manifest.json", b"{}")
    with pytest.raises(SessionFormatError, match="doubled names"):
        session_from_bytes(out.getvalue())


def test_more_members_than_a_session_has_are_refused(monkeypatch):
    data = session_bytes(session())
    monkeypatch.setattr(members, "MAX_MEMBERS", len(names_in(data)))
    assert session_from_bytes(data).name == session().name
    monkeypatch.setattr(members, "MAX_MEMBERS", len(names_in(data)) - 1)
    with pytest.raises(SessionFormatError, match="members"):
        session_from_bytes(data)


def test_a_zip_of_something_else_is_refused():
    data = rewritten(session_bytes(session()), dict.clear)
    with pytest.raises(SessionFormatError, match="not a session file"):
        session_from_bytes(data)


def test_an_exchanged_array_is_refused():
    def exchange(members):
        name = next(n for n in members if n.endswith("translations.npy"))
        buffer = io.BytesIO()
        np.save(buffer, np.zeros((60, 3)))
        members[name] = buffer.getvalue()

    with pytest.raises(SessionFormatError, match="digest"):
        session_from_bytes(rewritten(session_bytes(session()), exchange))


def test_a_zip_bomb_is_refused_before_it_is_unpacked(monkeypatch):
    monkeypatch.setattr(members, "MAX_STORED_BYTES", 10_000_000)
    bomb = resealed(lambda m: None, lambda m: m.update({"arrays/big.npy": bytes(20_000_000)}))
    with pytest.raises(SessionFormatError, match="unpacks to more than 10 MB"):
        session_from_bytes(bomb)


def resealed(change, members_change=lambda members: None) -> bytes:
    """A session file that somebody else has written: its digests hold, its content is strange."""

    def edit(members):
        members_change(members)
        manifest = json.loads(members.pop("manifest.json"))
        manifest["sha256"] = {k: hashlib.sha256(v).hexdigest() for k, v in members.items()}
        change(manifest)
        members["manifest.json"] = json.dumps(manifest).encode()

    return rewritten(session_bytes(session()), edit)


def of_session(**parts):
    return lambda manifest: manifest["session"].update(parts)


STRANGE = {
    "no session": lambda m: m.pop("session"),
    "a list as session": lambda m: m.update(session=[1]),
    "copies in a list": lambda m: m.update(copies=[1]),
    "recipes in a list": lambda m: m.update(packed=[1]),
    "no recipes": lambda m: m.update(packed={}),
    "a copy of nothing": lambda m: m.update(copies={"a": ["b"]}),
    "an id that leads elsewhere": of_session(id="../../elsewhere"),
    "the id of the alias": of_session(id="current"),
    "half a character": of_session(name="\ud800"),
    "no seed": lambda m: m["session"]["setup"].update(seed=-1),
    "too large a seed": lambda m: m["session"]["setup"].update(seed=10**30),
    "a radius that is no number": lambda m: m["session"]["setup"]["region"].update(
        radius_mm=float("nan")
    ),
    "a radius without end": lambda m: m["session"]["setup"]["region"].update(radius_mm=10**400),
    "a centre far away": lambda m: m["session"]["setup"]["region"].update(
        center_mesh_mm=[0.0, 0.0, 1e9]
    ),
}


@pytest.mark.parametrize("change", STRANGE.values(), ids=STRANGE)
def test_a_sealed_file_with_strange_content_is_refused(change):
    assert session_from_bytes(resealed(lambda m: None)).name == session().name
    with pytest.raises(SessionFormatError):
        session_from_bytes(resealed(change))


@pytest.mark.parametrize(
    "log", [b"\xff\xfe\n", b"{nope\n", b"[" * 100_000, b'{"number": NaN}', b'{"number": 1e999}']
)
def test_a_log_that_cannot_be_read_is_refused(log):
    with pytest.raises(SessionFormatError):
        session_from_bytes(resealed(lambda m: None, lambda ms: ms.update({"commands.jsonl": log})))


def array_of(header: dict, values: bytes) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, header)
    return out.getvalue() + values


@pytest.mark.parametrize(
    "blob",
    [
        array_of({"descr": "<f8", "fortran_order": False, "shape": (10**11,)}, b""),
        array_of({"descr": "|O", "fortran_order": False, "shape": (1,)}, bytes(8)),
        b"\x93NUMPY\x01\x00\x10\x00{'descr': '<f8' ",
        b"PK\x05\x06" + bytes(18),
        b"",
    ],
    ids=["more values than bytes", "objects", "half a header", "a zip", "nothing"],
)
def test_a_member_that_is_no_plain_array_is_refused_without_taking_memory(blob):
    with pytest.raises(SessionFormatError, match="not a plain array"):
        session_from_bytes(
            resealed(lambda m: None, lambda ms: ms.update({"arrays/session/x.npy": blob}))
        )


def test_a_packing_that_sessions_do_not_use_is_refused():
    data = session_bytes(session())
    out = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(data)) as old,
        zipfile.ZipFile(out, "w", zipfile.ZIP_LZMA) as new,
    ):
        for info in old.infolist():
            new.writestr(info.filename, old.read(info))
    with pytest.raises(SessionFormatError, match="packed"):
        session_from_bytes(out.getvalue())


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(NotFoundError, match=r"gone\.rona"):
        load_session(tmp_path / "gone.rona")


def test_a_file_that_is_written_quickly_is_larger_and_holds_the_same():
    session = load_session(WHOLE)
    quick, small = session_bytes(session, quick=True), session_bytes(session)
    assert len(quick) > 1.5 * len(small)
    assert session_bytes(session_from_bytes(quick)) == small


@pytest.mark.ci
def test_a_file_whose_steps_are_not_loaded_says_what_to_import():
    """In an interpreter of its own: here every step is known."""
    words = """
import sys
from rona_core.errors import SessionFormatError
from rona_core.session import load_session
try:
    load_session(sys.argv[1])
except SessionFormatError as error:
    print(error)
import rona_core.compose
load_session(sys.argv[1])
"""
    ended = subprocess.run(
        [sys.executable, "-c", words, demo_session()], capture_output=True, text=True, check=True
    )
    assert "`import rona_core.compose` makes them known" in ended.stdout


def test_samples_of_a_converter_are_kept_in_its_steps():
    steps = np.arange(-300, 300, dtype=np.float32) * np.float32(STEP)
    for array, kept in ((steps, np.int16), (steps + np.float32(STEP / 2.0), np.float32)):
        arrays = {}
        written = encode(array, "rf", arrays)
        assert arrays["rf"].dtype == kept
        np.testing.assert_array_equal(decode(written, NDArray[np.float32], arrays), array)


def test_a_lock_that_another_holds_is_not_waited_for_unless_asked(tmp_path):
    path = tmp_path / "lock"
    with path.open("wb") as one, path.open("wb") as other:
        assert lock_file(one.fileno())
        assert not lock_file(other.fileno())
        waiting = threading.Thread(target=lock_file, args=(other.fileno(),), kwargs={"wait": True})
        waiting.start()
        waiting.join(0.1)
        assert waiting.is_alive()
        one.close()
        waiting.join(10.0)
        assert not waiting.is_alive()
