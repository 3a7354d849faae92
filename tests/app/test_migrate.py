"""Files of older schemas: they load, and what they held is as valid as it was."""

import copy
import io
import json
import zipfile
from pathlib import Path

import pytest

from rona_core.app.queries import step_states
from rona_core.session.carry import stored_digests
from rona_core.session.codec import digest, encode
from rona_core.session.files import load_session, session_bytes, session_from_bytes
from rona_core.session.migrate import MIGRATIONS, SCHEMA, migrate

DEMO = Path(__file__).parents[2] / "sessions" / "demo.rona"


@pytest.fixture(scope="module")
def session():
    return load_session(DEMO)


def as_schema_1(data):
    """Return the bytes of a file with what schema 2 added taken away, digests included."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    manifest = json.loads(members["manifest.json"])
    smoothing = manifest["session"]["results"]["smoothing"]
    for name in ("refused", "radii_mm", "choice"):
        del smoothing["value"]["normals"][name]
    del smoothing["value"]["way_points_base"]
    smoothing["arguments"].pop("normal_step_mm", None)
    manifest["schema"] = 1
    return manifest, members


def test_every_schema_has_a_step_to_the_next():
    assert sorted(MIGRATIONS) == list(range(1, SCHEMA))


def test_a_migration_changes_a_copy(session):
    arrays = {}
    manifest = {"schema": 1, "session": encode(session, "session", arrays)}
    before = copy.deepcopy(manifest)
    assert migrate(manifest)["schema"] == SCHEMA
    assert manifest == before


def test_digests_can_be_had_from_a_file_without_its_classes(session):
    arrays = {}
    found = stored_digests(encode(session, "session", arrays), arrays)
    for name in ("tool", "pointer", "surface", "path", "smoothing", "roll", "detection", "maps"):
        assert found[f"results/{name}"] == digest(getattr(session.results, name).value)
    for name in ("tool", "pointer", "path", "scan"):
        assert found[f"captures/{name}"] == digest(getattr(session.captures, name))
    assert found["captures/surface"] == digest([digest(s) for s in session.captures.surface])


def test_results_of_an_older_file_stay_valid_and_stale_ones_stale(session):
    assert [state.state for state in step_states(session)] == ["done"] * 9
    manifest, members = as_schema_1(session_bytes(session))
    results = manifest["session"]["results"]
    arrays = {}
    encode(session, "session", arrays)
    old = stored_digests(manifest["session"], arrays)
    results["roll"]["inputs"]["smoothing"] = old["results/smoothing"]
    for stale in (False, True):
        if stale:
            results["roll"]["inputs"]["smoothing"] = "0" * 64
        members["manifest.json"] = json.dumps(manifest).encode()
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            for name, data in members.items():
                archive.writestr(name, data)
        loaded = session_from_bytes(buffer.getvalue())
        states = {s.name: s.state for s in step_states(loaded)}
        assert (states["roll"] == "stale") is stale
        assert states["smoothing"] == "done"
        assert loaded.results.smoothing.value.normals.refused == {}
        assert loaded.results.smoothing.value.normals.flags == ("ok",) * len(
            loaded.results.smoothing.value.normals
        )
