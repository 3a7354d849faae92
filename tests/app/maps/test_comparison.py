"""The robot's maps beside files: their own exports, another session, what is refused."""

import gzip
import io
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.maps.comparison import TRUTH, compare_maps, compare_with_truth
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.errors import (
    DegenerateGeometryError,
    InvalidInputError,
    StaleResultError,
    StepBlockedError,
)
from rona_core.evaluation.truth import rms
from rona_core.session.document import Session
from rona_core.session.files import load_session, session_bytes
from rona_ui.cli import main
from rona_ui.resources import demo_session
from tests.scenes import demo_parts
from tests.scenes.map_ct import ct_of

SMALL = Path(__file__).parents[2] / "sessions" / "whole.rona"

pytestmark = pytest.mark.usefixtures("readers_here")


@pytest.fixture(scope="module")
def bench():
    bench = new_workbench(demo_parts.demo())
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def demo(bench):
    return bench.session


@pytest.mark.parametrize("name", ["outer.ply", "bone.stl", "demo.rona"])
def test_maps_beside_themselves_differ_by_less_than_a_micrometre(demo, name):
    data = demo_session().read_bytes() if name.endswith(".rona") else REGISTRY.export(demo, name)
    found = compare_maps(demo, data, name)
    assert found.name == name
    for row in found.figures:
        if row.name != "fused":  # that is another surface
            assert row.rms_mm < 0.001
            assert row.coverage > 0.85  # all but the rim
    assert {row.name for row in found.figures} >= {"outer", "fused"}
    assert ("thickness" in {row.name for row in found.figures}) == (name != "outer.ply")


def test_the_truth_has_the_figures_that_the_page_shows(bench, demo):
    found = compare_with_truth(demo, bench.map_errors())
    rows, figures = {row.name: row for row in found.figures}, bench.figures()
    assert found.name == TRUTH
    assert rows["outer"].rms_mm == pytest.approx(figures["outer_rms_mm"])
    assert rows["inner"].rms_mm == pytest.approx(figures["inner_rms_mm"])
    assert rows["thickness"].bias_mm == pytest.approx(figures["thickness_bias_mm"])
    known = found.errors.errors_mm["thickness"]
    assert rows["thickness"].rms_mm == pytest.approx(rms(known[np.isfinite(known)]))
    assert 0.1 < rows["outer"].stated_mm < 0.5


def test_a_mesh_in_another_place_is_laid_under_the_outer_map(demo):
    mesh = trimesh.load(io.BytesIO(REGISTRY.export(demo, "bone.ply")), file_type="ply")
    mesh.apply_translation((1.0, -0.5, 1.5))
    data = mesh.export(file_type="stl")
    assert compare_maps(demo, data, "there.stl").figures[0].rms_mm > 1.0
    laid = compare_maps(demo, data, "there.stl", "surface")
    assert laid.place.surface.verdict in ("good", "weak")
    assert laid.figures[0].rms_mm < 0.05


@pytest.mark.slow
def test_maps_beside_a_ct_of_themselves_differ_by_little(demo):
    ct = ct_of(demo.results.maps.value)
    with pytest.raises(InvalidInputError, match="give the threshold"):
        compare_maps(demo, ct, "head.nii")
    found = compare_maps(demo, ct, "head.nii", threshold=750.0)
    rows = {row.name: row for row in found.figures}
    # at the rim of the inner map this bone has walls that no map has
    assert rows["outer"].p95_mm < 0.1
    assert rows["inner"].p95_mm < 0.1
    assert np.nanmedian(np.abs(found.errors.errors_mm["thickness"])) < 0.04
    assert rows["thickness"].coverage > 0.85
    packed = gzip.compress(ct_of(demo.results.maps.value, moved_mm=(1.0, -0.5, 1.5)), 1)
    laid = compare_maps(demo, packed, "there.nii.gz", "surface", threshold=750.0)
    assert compare_maps(demo, packed, "there.nii.gz", threshold=750.0).figures[0].p95_mm > 1.0
    assert laid.figures[0].p95_mm < 0.1


def test_what_is_no_reference_is_refused_by_name(demo):
    ply = REGISTRY.export(demo, "outer.ply")
    with pytest.raises(InvalidInputError, match="expected one of"):
        compare_maps(demo, ply, "outer.vtk")
    with pytest.raises(InvalidInputError, match=r"outer\.ply"):
        compare_maps(demo, ply[: len(ply) // 2], "outer.ply")
    metres = trimesh.load(io.BytesIO(ply), file_type="ply")
    metres.apply_scale(0.001)
    with pytest.raises(InvalidInputError, match="check the unit"):
        compare_maps(demo, metres.export(file_type="stl"), "metres.stl")
    metres.apply_scale(1000.0)
    metres.apply_translation((0.0, 0.0, 500.0))
    with pytest.raises(DegenerateGeometryError, match="register it"):
        compare_maps(demo, metres.export(file_type="stl"), "elsewhere.stl")
    with pytest.raises(StepBlockedError):
        compare_maps(demo, session_bytes(Session()), "empty.rona")
    with pytest.raises(StepBlockedError):
        compare_maps(Session(), ply, "outer.ply")
    bench = new_workbench(demo)
    try:
        bench.dispatch(SetProbe(name="1MHz"))
        with pytest.raises(StaleResultError, match="this session are stale"):
            compare_maps(bench.session, ply, "outer.ply")
    finally:
        bench.close()


def test_the_command_prints_the_figures(tmp_path, capsys):
    path = tmp_path / "bone.ply"
    path.write_bytes(REGISTRY.export(load_session(SMALL), "bone.ply"))
    assert main(["compare", str(SMALL), str(path)]) == 0
    text = capsys.readouterr().out
    assert "thickness nearest" in text
    assert main(["compare", str(SMALL), str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["figures"][0]["rms_mm"] < 0.001
    assert main(["compare", str(SMALL), str(tmp_path / "none.ply")]) == 2
    assert "none.ply" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_reads_a_ct_with_its_threshold(demo, tmp_path, capsys):
    head = tmp_path / "head.nii"
    head.write_bytes(ct_of(demo.results.maps.value))
    words = ["compare", str(demo_session()), str(head), "--json"]
    assert main(words) == 2
    assert "give the threshold" in capsys.readouterr().err
    assert main([*words, "--threshold", "750"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"][0]["p95_mm"] < 0.1
