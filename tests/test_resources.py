"""Files that are not code are found from a checkout and from an installed wheel."""

import re
import shutil
from pathlib import Path

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_ui import resources

ROOT = Path(__file__).resolve().parents[1]


def test_in_a_checkout_they_lie_at_the_top(monkeypatch):
    monkeypatch.delenv("RONA_SESSIONS", raising=False)
    assert resources.static_dir() == ROOT / "static"
    assert resources.sessions_dir() == ROOT / "sessions"
    assert resources.demo_session() == ROOT / "sessions" / "demo.rona"
    assert resources.static_dir().is_dir()


def test_a_named_folder_for_sessions_wins_and_is_made(monkeypatch, tmp_path):
    monkeypatch.setenv("RONA_SESSIONS", str(tmp_path / "mine"))
    assert resources.sessions_dir() == tmp_path / "mine"
    assert (tmp_path / "mine").is_dir()


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_installed_they_lie_in_the_package_and_sessions_with_the_user(
    monkeypatch, tmp_path, platform
):
    package = tmp_path / "site-packages" / "rona_ui"
    shutil.copytree(ROOT / "static", package / "_static")
    monkeypatch.setattr(resources, "PACKAGE", package)
    monkeypatch.setattr(resources.sys, "platform", platform)
    monkeypatch.delenv("RONA_SESSIONS", raising=False)
    for variable in ("HOME", "USERPROFILE", "LOCALAPPDATA"):
        monkeypatch.setenv(variable, str(tmp_path / "user"))
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    assert resources.static_dir() == package / "_static"
    assert resources.demo_session().parent == package / "_sessions"
    folder = resources.sessions_dir()
    assert folder.is_dir()
    assert folder.is_relative_to(tmp_path / "user")


def test_the_page_knows_every_step_by_the_title_that_the_list_has():
    script = (ROOT / "static" / "page" / "sessions" / "recover.js").read_text("utf-8")
    block = re.search(r"const STEP_WORDS = \{(.*?)\};", script, re.DOTALL)[1]
    words = dict(re.findall(r'(\w+): "([^"]+)"', block))
    assert words == {name: line.title for name, line in REGISTRY.lines.items()}
