"""The front door: what packages export, the page of the notebook, the reference, the examples."""

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

import rona_core
from docs.guide import api_reference
from examples import gallery

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [
    f"rona_core.{name}"
    for name in (
        "geometry geometry.surface devices calibration path robot ultrasound mapping session"
    ).split()
]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_exports_what_it_says_and_each_name_is_explained(package):
    module = importlib.import_module(package)
    assert module.__all__
    assert sorted(module.__all__) == sorted(set(module.__all__))
    for name in module.__all__:
        assert inspect.getdoc(getattr(module, name)), name
    with pytest.raises(AttributeError):
        _ = module.nothing


def test_the_core_is_imported_at_once_and_its_parts_when_asked_for():
    code = (
        "import sys, rona_core; sys.exit(bool({'numpy', 'rona_core.compose'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
    with pytest.raises(AttributeError, match="nothing"):
        _ = rona_core.nothing


@pytest.mark.ci
def test_readers_of_foreign_files_are_imported_when_there_is_one():
    dear = {"scipy.signal", "scipy.stats", "scipy.io", "h5py", "nibabel", "nrrd"}
    verbs = "rona_ui.cli.serve, rona_ui.cli.demo"
    code = f"import sys, {verbs}; sys.exit(bool({dear!r} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_a_session_is_started_and_opened():
    new = rona_core.new_session("mine", seed=7)
    opened = rona_core.open(ROOT / "sessions" / "demo.rona")
    assert (new.session.name, new.session.setup.seed) == ("mine", 7)
    assert opened.session.results.maps is not None
    for bench in (new, opened):
        bench.close()


@pytest.mark.slow
def test_the_blocks_of_the_notebook_page_run(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    text = (ROOT / "docs" / "guide" / "notebook.md").read_text("utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) >= 5
    names = {}
    for block in blocks:
        exec(compile(block, "notebook.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "307 -> " in printed
    assert float(re.search(r"radius ([\d.]+) mm", printed)[1]) == pytest.approx(40.0, abs=0.1)
    assert "first_steps" in printed or "first steps" in printed


@pytest.mark.slow
def test_the_reference_has_a_page_for_every_package_and_an_entry_for_every_name(tmp_path):
    files = api_reference.write(tmp_path)
    assert {f.stem for f in files} == {"rona_core", *PACKAGES}
    for file in files:
        entries = re.findall(r"^## (\w+)$", file.read_text("utf-8"), flags=re.MULTILINE)
        assert entries == sorted(importlib.import_module(file.stem).__all__)
    assert "simplify(points" in (tmp_path / "rona_core.path.md").read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(gallery.QUICK))
def test_an_example_runs_and_draws_its_picture(name, capsys):
    drawn = gallery.QUICK[name]()
    assert capsys.readouterr().out
    picture = ElementTree.fromstring(drawn)
    shapes = [node.tag.rpartition("}")[2] for node in picture.iter()]
    assert shapes.count("circle") + shapes.count("polyline") >= 1
    assert (gallery.FOLDER / f"{name}.svg").is_file()
    assert f"../images/gallery/{name}.svg" in (ROOT / "docs" / "guide" / "gallery.md").read_text(
        "utf-8"
    )
