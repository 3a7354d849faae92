"""Files of older programs still load, and say what was not known then."""

import io
import json
import zipfile
from pathlib import Path

from rona_core.session.files import load_session, session_from_bytes
from rona_core.session.migrate import MIGRATIONS, SCHEMA

DEMO = Path(__file__).parents[2] / "sessions" / "demo.rona"
NEW_IN_2 = ("frechet", "closed", "lower_bound", "exact", "rule")


def as_schema_1(path):
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    manifest = json.loads(members["manifest.json"])
    manifest["schema"] = 1
    for key in NEW_IN_2:
        del manifest["session"]["results"]["smoothing"]["value"]["simplified"][key]
    members["manifest.json"] = json.dumps(manifest).encode()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def test_there_is_a_step_from_every_schema_to_the_present_one():
    assert sorted(MIGRATIONS) == list(range(1, SCHEMA))


def test_a_smoothed_path_of_schema_1_claims_no_more_than_it_knew():
    path = load_session(DEMO).results.smoothing.value.simplified
    old = session_from_bytes(as_schema_1(DEMO)).results.smoothing.value.simplified
    assert old.index.tolist() == path.index.tolist()
    assert (old.method, old.tolerance, old.k1_mm) == (path.method, path.tolerance, path.k1_mm)
    assert (old.frechet, old.closed, old.lower_bound, old.exact) == (False, False, 2, False)
    assert "schema 1" in old.rule


def test_a_step_changes_nothing_else_and_not_its_input():
    before = {"schema": 1, "session": {"name": "a", "results": {"smoothing": None}}}
    copy = json.loads(json.dumps(before))
    assert MIGRATIONS[1](before) == before == copy
