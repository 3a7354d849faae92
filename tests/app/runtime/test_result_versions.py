"""Each result carries the version that made it; a replay says which differ because of it."""

import json
import zipfile
from dataclasses import replace
from io import BytesIO

import pytest

from rona_core import __version__
from rona_core.app.dependencies.changes import done
from rona_core.app.runtime.session_step import replay, replay_report
from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.devices.protocols import never, silent
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import session_bytes, session_from_bytes

OTHER = "0.0.7"


@pytest.fixture(scope="module")
def bench():
    made = new_workbench(Session(name="versions"))
    made.run(StartToolCapture(n_pivot=8, n_translate=3))
    made.run(StartPointerCapture(duration_s=2.0))
    yield made
    made.close()


def derived(session):
    held = session.results
    named = {name: getattr(held, name) for name in ("tool", "pointer", "surface", "roll", "maps")}
    return {name: made for name, made in {**named, **held.more}.items() if made is not None}


def as_written_by(session, version):
    """The session as read from a file of another version."""
    file = BytesIO()
    with (
        zipfile.ZipFile(BytesIO(session_bytes(session))) as given,
        zipfile.ZipFile(file, "w") as made,
    ):
        for name in given.namelist():
            data = given.read(name)
            if name == "manifest.json":
                manifest = json.loads(data)
                manifest["app_version"] = version
                for result in manifest["session"]["results"].values():
                    if isinstance(result, dict) and "version" in result:
                        result["version"] = version
                data = json.dumps(manifest).encode()
            made.writestr(name, data)
    return session_from_bytes(file.getvalue())


def changed(session, name):
    """The session with a result that the program would not compute."""
    held = session.results.get(name)
    return session.with_result(name, replace(held, value=replace(held.value, rmse_mm=9.0)))


def test_what_is_computed_carries_the_version_of_this_program(bench):
    made = derived(bench.session)
    assert set(made) == {"tool", "pointer"}
    assert {held.version for held in made.values()} == {__version__}
    again = session_from_bytes(session_bytes(bench.session))
    assert digest(again) == digest(bench.session)


def test_a_file_keeps_the_version_of_each_result(bench):
    session = as_written_by(bench.session, OTHER)
    assert {held.version for held in derived(session).values()} == {OTHER}
    saved = session_from_bytes(session_bytes(session))  # by this program
    assert {held.version for held in derived(saved).values()} == {OTHER}


def test_the_results_of_the_demo_session_have_a_version(demo):
    made = derived(demo)
    assert len(made) > 5
    assert all(held.version for held in made.values())


def test_a_result_computed_again_has_the_version_of_now_and_the_others_keep_theirs(bench):
    other = new_workbench(as_written_by(bench.session, OTHER))
    other.dispatch(CalibratePointer())
    versions = {name: held.version for name, held in derived(other.session).items()}
    other.close()
    assert versions == {"tool": OTHER, "pointer": __version__}


@pytest.mark.parametrize("version", [__version__, OTHER, ""])
@pytest.mark.parametrize("differing", [(), ("pointer",), ("tool", "pointer")])
def test_a_replay_says_which_results_differ_and_whether_another_version_made_them(
    bench, version, differing
):
    session = bench.session
    for name in differing:
        session = changed(session, name)
    session = as_written_by(session, version)
    report = replay_report(session, progress=silent, cancel=never)
    assert report.results == replay(session)
    assert (report.same, report.version) == (not differing, __version__)
    assert report.by_version == (() if version == __version__ else differing)
    for row in report.results:
        assert row.same == (row.result not in differing)
        assert row.version == version
        if row.same:
            assert row.difference is None
        elif version == __version__:
            assert "another processor" in row.difference
        else:
            by = f"RONA {version}" if version else "an unknown version of RONA"
            assert f"{done(row.result)} by {by}, and RONA {__version__}" in row.difference
