"""Files of a session's maps: all of them, in one archive, with what the program states of them."""

import csv
import hashlib
import io
import json
import zipfile

import numpy as np
import pytest
import trimesh

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.maps.export import ALL, EXPORTS, FRAME, MANIFEST
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.errors import NotFoundError, StaleResultError, StepBlockedError
from rona_core.session.document import Session
from rona_ui.cli import main
from rona_ui.resources import demo_session
from tests.oracles.maps_nrrd import read_maps_nrrd


@pytest.fixture(scope="module")
def archive(demo):
    data = REGISTRY.export(demo, ALL)
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        assert file.testzip() is None
        return {name: file.read(name) for name in file.namelist()}


def test_the_archive_holds_every_file_and_says_what_they_are(demo, archive):
    assert set(archive) == {*(one.name for one in EXPORTS), MANIFEST} - {ALL}
    manifest = json.loads(archive[MANIFEST])
    assert manifest["session"]["id"] == demo.id
    assert manifest["frame"] == FRAME
    told = {row["name"]: row["sha256"] for row in manifest["files"]}
    assert told == {
        name: hashlib.sha256(data).hexdigest() for name, data in archive.items() if name in told
    }
    assert REGISTRY.export(demo, "outer.ply") == archive["outer.ply"]


def test_the_same_maps_give_the_same_archive(demo):
    assert REGISTRY.export(demo, ALL) == REGISTRY.export(demo, ALL)


def test_values_are_those_of_the_maps_and_sigmas_what_is_stated(demo, archive):
    maps, stated = demo.results.maps.value, map_accuracy(demo)
    rows = list(csv.DictReader(io.StringIO(archive["maps.csv"].decode("ascii"))))
    for name in ("outer", "inner", "fused"):
        own = getattr(maps, name)
        np.testing.assert_allclose(
            read_maps_nrrd(archive["maps.nrrd"])[name].points_base(), own.points_base(), atol=1e-6
        )
        told = [float(row[f"{name}_sigma_total_mm"]) for row in rows if row[f"{name}_x_mm"]]
        total = getattr(stated, name).total_mm()[own.ok]
        known = np.isfinite(total)
        np.testing.assert_allclose(told, total[known], atol=1e-5)
    both = maps.outer.ok & maps.inner.ok
    own, common = (
        [float(row[f"thickness_sigma_{part}_mm"]) for row in rows if row["thickness_mm"]]
        for part in ("own", "common")
    )
    np.testing.assert_allclose(np.hypot(own, common), stated.thickness.total_mm()[both], atol=1e-5)


def test_the_bone_is_a_body_in_the_place_of_the_robot(demo, archive):
    body = trimesh.load(io.BytesIO(archive["bone.ply"]), file_type="ply", process=False)
    assert body.is_watertight
    outer = demo.results.maps.value.outer
    assert np.abs(body.centroid - outer.points_base().mean(axis=0)).max() < 10.0


def test_maps_that_do_not_count_are_not_exported(demo):
    with pytest.raises(StepBlockedError, match="compute the maps"):
        REGISTRY.export(Session(), ALL)
    with pytest.raises(NotFoundError, match="there is no file"):
        REGISTRY.export(demo, "bone.stp")
    bench = new_workbench(demo)
    try:
        bench.dispatch(SetProbe(name="1MHz"))
        with pytest.raises(StaleResultError, match="maps are stale"):
            REGISTRY.export(bench.session, "bone.stl")
        bench.dispatch(Undo())
        assert REGISTRY.export(bench.session, "bone.stl")
    finally:
        bench.close()


@pytest.mark.ci
def test_the_command_line_writes_them(demo, tmp_path, capsys):
    wanted = ["--only", "bone.stl", "--only", "maps.csv"]
    assert main(["export", str(demo_session()), str(tmp_path / "out"), *wanted]) == 0
    held = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert held == {name: REGISTRY.export(demo, name) for name in ("bone.stl", "maps.csv")}
    assert "bone.stl" in capsys.readouterr().out
    assert main(["export", str(demo_session()), str(tmp_path / "new"), "--only", "all"]) == 2
    assert not (tmp_path / "new").exists()
    assert "there is no file 'all'" in capsys.readouterr().err
