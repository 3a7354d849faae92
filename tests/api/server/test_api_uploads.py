"""Uploads go to a file while they arrive: what is refused leaves neither memory nor files."""

from pathlib import Path

import pytest

from rona_core.app.runtime.saving.session_files import MAX_UPLOAD_BYTES
from rona_core.session.document import Session
from rona_core.session.files import session_bytes

MIB = bytes(1 << 20)


def peak_mb():
    lines = Path("/proc/self/status").read_text("ascii").splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024


@pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="peaks of memory are told by /proc"
)
@pytest.mark.parametrize("kind", ["uploads", pytest.param("session", marks=pytest.mark.slow)])
def test_an_endless_upload_is_refused_and_takes_no_memory(at, client, web, kind):
    def endless():
        for _ in range(MAX_UPLOAD_BYTES // len(MIB) + 20):
            yield MIB

    Path("/proc/self/clear_refs").write_text("5")
    before = peak_mb()
    name = {"name": "a.rona"}
    if kind == "uploads":
        answer = at("POST", "/uploads", params=name, content=endless())
    else:
        answer = client.post("/sessions/upload", params=name, content=endless())
    assert answer.status_code == 413, answer.text
    assert peak_mb() - before < 100
    assert not list(web.hub.files.uploads.glob(".upload.*"))


def test_what_is_uploaded_is_kept_under_its_name(at, web):
    data = bytes(range(256)) * 8192
    answer = at("POST", "/uploads", params={"name": "a.nrrd"}, content=data)
    assert answer.json() == {"file": "a.nrrd", "size_bytes": len(data)}
    assert (web.hub.files.uploads / "a.nrrd").read_bytes() == data
    assert (web.hub.files.uploads / "a.nrrd").stat().st_mode & 0o777 == 0o644
    assert not list(web.hub.files.uploads.glob(".upload.*"))


def test_an_uploaded_session_leaves_no_file_behind(client, web):
    data = session_bytes(Session(name="there"))
    upload = "/sessions/upload"
    answer = client.post(upload, params={"name": "b.rona"}, content=data)
    assert answer.json()["name"] == "there"
    answer = client.post(upload, params={"name": "b.rona"}, content=data[:100])
    assert answer.status_code == 422
    assert "b.rona: the file is damaged: its end is missing" in answer.json()["detail"]
    assert not list(web.hub.files.uploads.glob(".upload.*"))
