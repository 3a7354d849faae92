"""Whatever the file system refuses, wherever something is written, says its cause and a way out."""

import ast
import errno
import io
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.runtime.jobs import Jobs
from rona_core.app.steps.scan.messages import StartScan
from rona_core.devices.files.reader_process import read_apart
from rona_core.errors import REFUSED, RonaError, StorageError, storage_error
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session, session_bytes, write_whole
from rona_ui.cli import export, main
from rona_ui.resources import sessions_dir
from rona_ui.viewer import bindings
from tests.helpers.readers_apart import unsaved
from tests.tools import structure

REPOSITORY = Path(__file__).resolve().parents[3]
WRITES = {"write_bytes", "write_text", "mkdir", "replace", "link", "mkstemp", "copy2", "fdopen"}
WRITES |= {"TemporaryDirectory", "TemporaryFile", "makedirs", "rename", "symlink"}
CALLED = re.compile(rf"\.\s*({'|'.join(sorted(WRITES | {'open', 'save'}))})\s*\(")
# who writes -> what of this file has it refused; a new one is to be added with its own
PLACES = {
    "rona_core/app/runtime/saving/journal.py": "tests/app/runtime/test_autosave.py",
    "rona_core/app/runtime/saving/autosave.py": "tests/app/runtime/test_autosave.py",
    "rona_core/devices/files/reader_process.py": "a recording is read",
    "rona_core/devices/files/ros_bags.py": "a recording is read",
    "rona_core/session/files.py": "a session is saved",
    "rona_core/study/folder.py": "tests/study/test_study_run.py",
    "rona_ui/api/bodies.py": "a file is uploaded",
    "rona_ui/cli/calibrate.py": "tests/api/cli/test_cli_hand_eye.py",
    "rona_ui/cli/export.py": "maps are exported",
    "rona_ui/cli/figures.py": "tests/api/cli/test_cli_figures.py",
    "rona_ui/cli/report.py": "a report is written",
    "rona_ui/cli/serve.py": "the sessions folder is tried",
    "rona_ui/cli/verify.py": "tests/api/cli/test_cli_verify.py",
    "rona_ui/resources.py": "the sessions folder is made",
}
ERRNOS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota of this user is used up",
    errno.EROFS: "the file system is read-only",
    errno.EACCES: "this user has no right to do that",
    errno.EIO: "the disk reports an error",
}
CALLS = ("mkdir", "mkstemp", "open", "write", "fsync", "chmod", "replace")


class Refusing:
    """Has the n-th call of one kind that writes below a folder refused, by all ways to it."""

    def __init__(self, monkeypatch, kind, number, folders):
        self.kind, self.count, self.refused = kind, 0, False
        self._number, self.folders = number, tuple(str(f) for f in folders)
        self._patch, self._fds = monkeypatch, {}
        self.code = errno.ENOSPC
        for name in ("mkdir", "fsync", "chmod", "replace"):
            self._replace(os, name)
        self._replace(tempfile, "mkstemp")
        self._genuine_fdopen, self._genuine_open = os.fdopen, io.open
        monkeypatch.setattr(os, "fdopen", self._fdopen)
        monkeypatch.setattr(io, "open", self._open)
        monkeypatch.setattr("builtins.open", self._open)

    def check(self, kind, place):
        place = str(place)
        if kind != self.kind or not place.startswith(self.folders):
            return
        if ".autosave" in place or (kind == "mkdir" and os.path.isdir(place)):
            return  # a copy that fails is a state of the session; what is there need not be made
        self.count += 1
        if self.count == self._number:
            self.refused = True
            raise OSError(self.code, os.strerror(self.code))

    def _replace(self, module, name):
        genuine = getattr(module, name)

        def guarded(*args, **rest):
            place = args[0]
            if name == "mkstemp":
                place = args[2] if len(args) > 2 else rest.get("dir", tempfile.gettempdir())
            if name == "fsync":
                place = os.readlink(f"/proc/self/fd/{args[0]}")
            self.check(name, place)
            return genuine(*args, **rest)

        self._patch.setattr(module, name, guarded)

    def _fdopen(self, descriptor, mode="r", *args, **rest):
        opened = self._genuine_fdopen(descriptor, mode, *args, **rest)
        if not isinstance(descriptor, int) or "b" not in mode or "r" in mode:
            return opened
        return Watched(opened, self, os.readlink(f"/proc/self/fd/{descriptor}"))

    def _open(self, file, mode="r", *args, **rest):
        if not set("wxa+") & set(mode):
            return self._genuine_open(file, mode, *args, **rest)
        self.check("open", file)
        return Watched(self._genuine_open(file, mode, *args, **rest), self, file)


class Watched:
    """A file whose writing may be refused."""

    def __init__(self, file, refusing, path):
        self._file, self._refusing, self._path = file, refusing, path

    def __getattr__(self, name):
        return getattr(self._file, name)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()

    def write(self, data):
        self._refusing.check("write", self._path)
        return self._file.write(data)

    def writelines(self, lines):
        self._refusing.check("write", self._path)
        return self._file.writelines(lines)


def test_every_place_that_writes_is_swept():
    found = set()
    for package in ("rona_core", "rona_ui"):
        for path in (REPOSITORY / package).rglob("*.py"):
            may_write = CALLED.search(path.read_text("utf-8"))
            if may_write and any(_writes(node) for node in ast.walk(structure.tree(path))):
                found.add(str(path.relative_to(REPOSITORY)))
    assert found == set(PLACES)
    scenarios = {*SCENARIOS, "the sessions folder is tried", "the sessions folder is made"}
    assert {v for v in PLACES.values() if not v.startswith("tests/")} <= scenarios
    for page in {v for v in PLACES.values() if v.startswith("tests/")}:
        assert "OSError(28" in (REPOSITORY / page).read_text("utf-8")


def _writes(node):
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
        return False
    if node.func.attr not in WRITES | {"open", "save"}:
        return False
    owner = ast.unparse(node.func.value)
    if node.func.attr == "replace":
        return owner == "os"
    if node.func.attr == "open" and owner != "os":
        mode = [a.value for a in node.args if isinstance(a, ast.Constant)]
        texts = [m for m in mode if isinstance(m, str)]
        return any(set(m) <= set("wxabt+") and set(m) & set("wxa") for m in texts)
    return node.func.attr in WRITES or (owner, node.func.attr) == ("np", "save")


# -- what is written, and what is to be seen of a refusal ------------------------------------------


def saved(folder, client, capsys):
    """Save over a file that is there."""
    path = folder / "one.rona"
    before = path.read_bytes()
    try:
        save_session(Session(name="second"), path)
    except StorageError as error:
        whole = load_session(path).name  # once it is there, the folder may still be refused
        assert path.read_bytes() == before or whole == "second"
        assert not list(folder.glob(".*.part"))
        return str(error)
    return None


def uploaded(folder, client, capsys):
    where, data = "/sessions/current/uploads", b"x" * 3_000_000
    return _refusal(client.post(where, params={"name": "a.bin"}, content=data))


def uploaded_session(folder, client, capsys):
    data = session_bytes(Session(name="up"))
    return _refusal(client.post("/sessions/upload", params={"name": "b.rona"}, content=data))


def saved_by_rest(folder, client, capsys):
    return _refusal(client.post("/sessions/current/save", json={"file": "rest", "replace": True}))


def _refusal(answer):
    if answer.is_success:
        return None
    assert (answer.status_code, answer.json()["code"]) == (507, "storage"), answer.text
    return answer.json()["detail"]


def by_cli(*words):
    def run(folder, client, capsys):
        capsys.readouterr()
        shutil.rmtree(folder / "new", ignore_errors=True)
        status = main([word.format(folder=folder) for word in words])
        told = capsys.readouterr().err
        if status == 0:
            return None
        assert status == 2
        assert "Traceback" not in told
        assert "a defect" not in told
        return told

    return run


def read(folder, client, capsys):
    try:
        read_apart(numbers, b"content", "a.h5", "HDF5")
    except StorageError as error:
        return str(error)
    return None


def found_nothing(command, **_):
    place = Path(json.loads(command[-1])[2])
    descriptor = os.open(place / "report.json", os.O_WRONLY | os.O_CREAT)
    os.write(descriptor, b'{"arrays": {}}')
    os.close(descriptor)
    return subprocess.CompletedProcess(command, 0)


def numbers(path, name):
    return {"rf": np.zeros(3)}


SCENARIOS = {
    "a session is saved": saved,
    "a session is saved over REST": saved_by_rest,
    "a file is uploaded": uploaded,
    "a session is uploaded": uploaded_session,
    "maps are exported": by_cli("export", "{folder}/one.rona", "{folder}/new/maps"),
    "a report is written": by_cli("report", "{folder}/one.rona", "{folder}/r.html"),
    "a recording is read": read,
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_refusal_anywhere_says_cause_and_remedy(name, web, client, tmp_path, monkeypatch, capsys):
    """Every call that writes, each time it happens, is refused once."""
    save_session(Session(name="first"), tmp_path / "one.rona")
    session = client.post("/sessions", json={"name": "refused"}).json()["id"]
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setattr(export.REGISTRY, "export", lambda session, name: b"maps")
    monkeypatch.setattr(subprocess, "run", found_nothing)  # of the process that reads: see below
    refusals = 0
    for kind in CALLS:
        for number in range(1, 9):
            code = list(ERRNOS)[refusals % len(ERRNOS)]
            with monkeypatch.context() as patch:
                refusing = Refusing(patch, kind, number, (tmp_path, web.folder))
                refusing.code = code
                said = SCENARIOS[name](tmp_path, client, capsys)
            if not refusing.refused:
                break
            refusals += 1
            assert said is not None, f"{kind} {number} was refused without a word"
            assert ERRNOS[code] in said, said
            assert "; " in said, said
        assert not list(web.folder.glob(".*.part"))
        assert not list((web.folder / ".uploads").glob(".upload.*"))
    assert refusals >= 2
    assert SCENARIOS[name](tmp_path, client, capsys) is None  # and afterwards it works
    client.delete(f"/sessions/{session}")


def test_a_folder_that_cannot_be_made_is_said(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("RONA_SESSIONS", str(tmp_path / "file" / "sessions"))
    with pytest.raises(StorageError, match="a part of the path is no folder; choose another"):
        sessions_dir()
    assert main(["serve", "--no-open", "--sessions", str(tmp_path / "file" / "sessions")]) == 2
    assert "choose another folder with --sessions" in capsys.readouterr().err


def test_what_a_reader_finds_and_cannot_be_put_down_is_no_damaged_file(monkeypatch):
    with pytest.raises(StorageError, match="free space there, or set TMPDIR"):
        read_apart(unsaved, b"content", "a.h5", "HDF5")


def test_a_job_that_the_disk_ends_is_no_defect(capsys):
    jobs = Jobs()

    def work(progress, cancel):
        raise OSError(errno.ENOSPC, "No space left on device", "/data/a.rona")

    status = jobs.wait(jobs.start(StartScan(), work, device=False).id, 20)
    assert (status.state, status.error_code) == ("failed", "storage")
    assert "/data/a.rona: the disk is full; free space there" in status.error
    assert capsys.readouterr().err == ""


def test_the_browser_shows_cause_and_remedy_and_no_defect(capsys):
    error = OSError(errno.EROFS, "Read-only file system", "/data/a.rona")
    title, body = bindings.error_words(error)
    assert title == "File cannot be written or read"
    assert "the file system is read-only" in body
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("code", sorted({*REFUSED, errno.EBUSY, errno.ENXIO}))
def test_every_cause_has_a_remedy_and_the_error_stays_one_of_the_system(code):
    error = storage_error(OSError(code, os.strerror(code), "/data/a.rona"))
    assert isinstance(error, OSError)
    assert isinstance(error, RonaError)
    cause, _, remedy = str(error).partition("; ")
    assert cause.startswith("the file system refused /data/a.rona: ")
    assert remedy
    assert storage_error(error) is error


def test_the_whole_that_is_there_stays(tmp_path, monkeypatch):
    path = write_whole(tmp_path / "a.bin", b"one")
    monkeypatch.setattr(os, "replace", _full)
    with pytest.raises(StorageError, match=r"a\.bin: the disk is full"):
        write_whole(path, b"two")
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]
    assert path.read_bytes() == b"one"


def _full(*_):
    raise OSError(errno.ENOSPC, "No space left on device")
