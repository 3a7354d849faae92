"""The files that can be opened, and their pictures."""

import os

import pytest

from rona_core.session.document import Session
from rona_core.session.files import save_session
from rona_ui.api.routes.files import MAX_PICTURE_BYTES

PICTURE = b"\xff\xd8\xff\xe0 of a scene"


@pytest.fixture
def saved(client, web):
    """The id of a session that is saved in a file of its own."""
    made = client.post("/sessions", json={"name": "pictured"}).json()["id"]
    client.post(f"/sessions/{made}/save").raise_for_status()
    yield made
    client.delete(f"/sessions/{made}")
    (web.folder / "pictured.rona").unlink()


def entry(client, name):
    return next(each for each in client.get("/files").json()["files"] if each["file"] == name)


def test_files_are_listed_the_newest_first(client, web):
    paths = [web.folder / f"aged {n}.rona" for n in range(3)]
    for age, path in zip((50, 10, 30), paths, strict=True):
        save_session(Session(name="aged"), path)
        os.utime(path, (1_700_000_000 - age, 1_700_000_000 - age))
    listed = client.get("/files").json()["files"]
    aged = [each for each in listed if each["file"].startswith("aged")]
    assert [each["file"] for each in aged] == ["aged 1.rona", "aged 2.rona", "aged 0.rona"]
    assert aged[0]["changed_utc"] == "2023-11-14T22:13:10+00:00"
    assert aged[0]["size_bytes"] == paths[1].stat().st_size
    assert not any(each["picture"] for each in aged)
    for path in paths:
        path.unlink()


def test_a_picture_is_kept_until_the_file_is_written_again(client, web, saved):
    at = f"/sessions/{saved}"
    assert not entry(client, "pictured.rona")["picture"]
    assert client.get("/files/pictured.rona/picture").status_code == 404
    assert client.put(f"{at}/picture", content=PICTURE).status_code == 204
    assert entry(client, "pictured.rona")["picture"]
    answer = client.get("/files/pictured.rona/picture")
    assert (answer.content, answer.headers["content-type"]) == (PICTURE, "image/jpeg")
    later = web.folder / "pictured.rona"
    os.utime(later, ns=(later.stat().st_atime_ns, later.stat().st_mtime_ns + 10**10))
    assert not entry(client, "pictured.rona")["picture"]  # of another state than the file's
    assert client.get("/files/pictured.rona/picture").status_code == 404


def test_what_is_no_small_picture_or_of_no_file_is_refused(client, web, saved):
    at = f"/sessions/{saved}"
    for body, status in (
        (b"<svg/>", 422),
        (b"", 422),
        (PICTURE + bytes(MAX_PICTURE_BYTES), 413),
    ):
        assert client.put(f"{at}/picture", content=body).status_code == status
    client.post(f"{at}/commands/SetSeed", json={"seed": 5}).raise_for_status()
    assert client.put(f"{at}/picture", content=PICTURE).status_code == 422  # not as it was saved
    other = client.post("/sessions").json()["id"]
    assert client.put(f"/sessions/{other}/picture", content=PICTURE).status_code == 422
    client.delete(f"/sessions/{other}")
    assert client.put(f"/sessions/{other}/picture", content=PICTURE).status_code == 404
    assert not entry(client, "pictured.rona")["picture"]


@pytest.mark.parametrize("name", ["..%2Fsecret", ".hidden", "no such.rona", "a%5Cb.rona"])
def test_a_picture_of_nothing_is_refused(client, name):
    assert client.get(f"/files/{name}/picture").status_code in (404, 422)
