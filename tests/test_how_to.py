"""How-to pages are followed: the changes are made in a copy of the program, and their code runs."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("add_a_probe", "add_a_robot", "add_an_export", "add_a_figure")
SEEN = """
import json
from pathlib import Path
from types import SimpleNamespace
import rona_core
from rona_core.app.overview.acceptance import quality_rows
from rona_core.compose import build_registry
from rona_core.session.document import Session
from rona_ui.cli import _parser
from rona_ui.cli.export import run as export
from rona_ui.panels.layout.quality import table
from rona_ui.panels.maps.maps import MapExportFolder
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.server import bare_app
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import Recorder

here = Path.cwd()
assert Path(rona_core.__file__).is_relative_to(here), rona_core.__file__
hub = build_registry(here / "own", processes=False)
document = bare_app(hub, None).openapi()
hub.close_all()
schemas, paths = document["components"]["schemas"], document["paths"]
path = next(where for where in paths if where.endswith("/export/{name}"))
name = next(one for one in paths[path]["get"]["parameters"] if one["name"] == "name")
gui = FakeGui()
SetupPanel(gui, Recorder().context)
MapExportFolder(gui, Recorder().context)
rows = quality_rows({"thickness_p95_mm": 0.25})
verbs = next(a for a in _parser()._actions if a.choices).choices
wanted = SimpleNamespace(file=SESSION, only=["outer.xyz"], kinds=[], out=here / "out")
assert export(wanted) == 0
print("SEEN " + json.dumps({
    "rest": {
        "add_a_probe": schemas["SetProbe"]["properties"]["name"]["enum"],
        "add_a_robot": schemas["SetRobot"]["properties"]["model"]["enum"],
        "add_an_export": name["schema"]["enum"],
        "add_a_figure": [row.key for row in rows],
    },
    "page": {
        "add_a_probe": list(gui.find("dropdown", "Probe").options),
        "add_a_robot": list(gui.find("dropdown", "Arm").options),
        "add_an_export": list(gui.find("dropdown", "File").options),
        "add_a_figure": [table(rows)],
    },
    "terminal": {
        "add_a_probe": [verbs["detect"].format_help()],
        "add_a_robot": [verbs["demo"].format_help()],
        "add_an_export": [one.name for one in (here / "out").iterdir()],
        "add_a_figure": [row.title for row in rows],
    },
}))
"""
NEW = {  # as it is written in REST, on the page, in the terminal
    "add_a_probe": ("3.5MHz", "3.5 MHz", "3.5MHz"),
    "add_a_robot": ("ur3", "UR3", "ur3"),
    "add_an_export": ("outer.xyz", "outer.xyz", "outer.xyz"),
    "add_a_figure": ("thickness_p95_mm", "Thickness, 95 %", "Thickness, 95 %"),
}


def blocks(page, kind):
    text = (ROOT / "docs" / "how-to" / f"{page}.md").read_text("utf-8")
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def change(folder, diff):
    """Make a change: each part names a file, and its lines stand there once as they were before."""
    changed = set()
    for part in re.split(r"^--- ", diff, flags=re.MULTILINE)[1:]:
        name, _, lines = part.partition("\n")
        rows = lines.splitlines(keepends=True)
        before = "".join(row[1:] for row in rows if row[0] in " -")
        after = "".join(row[1:] for row in rows if row[0] in " +")
        path = folder / name
        text = path.read_text("utf-8")
        assert text.count(before) == 1, f"{name} has {text.count(before)} times:\n{before}"
        path.write_text(text.replace(before, after), "utf-8")
        changed.add(name)
    return changed


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """What the copy shows once all pages were followed, in one process; files changed by page."""
    copy = tmp_path_factory.mktemp("copy")
    for name in ("rona_core", "rona_ui"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("static", "sessions", "tests", "pyproject.toml"):
        (copy / name).symlink_to(ROOT / name)
    files = {page: set() for page in PAGES}
    for page in PAGES:
        for diff in blocks(page, "diff"):
            files[page] |= change(copy, diff)
    session = ROOT / "sessions" / "demo.rona"
    code = [code for page in PAGES for code in blocks(page, "python")]
    script = copy / "followed.py"
    script.write_text("\n".join([*code, f"SESSION = {str(session)!r}", SEEN]), "utf-8")
    run = subprocess.run(
        [sys.executable, str(script)],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-4000:]
    return json.loads(run.stdout.partition("SEEN ")[2]), files


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_adds_is_in_rest_on_the_page_and_in_the_terminal(followed, page):
    seen, files = followed
    assert 1 <= len(files[page]) <= 2
    for where, new in zip(("rest", "page", "terminal"), NEW[page], strict=True):
        assert any(new == one or (" " in one and new in one) for one in seen[where][page]), where
