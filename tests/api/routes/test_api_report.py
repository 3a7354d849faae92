"""The report over REST, from the command line and by its button: one and the same page."""

import pytest

from rona_core.app.report.report import workbench_report
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_core.session.files import save_session
from rona_ui.cli import main


@pytest.fixture(scope="module")
def bench():
    made = new_workbench(Session(name="bone <b>7</b>"))
    yield made
    made.close()


def test_over_rest_it_may_run_no_script(web, client, at):
    answer = at("GET", "/report")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:")
    assert "script-src" not in policy
    made = client.post("/sessions", json={"name": "<i>"}).json()["id"]
    try:
        answer = client.get(f"/sessions/{made}/report")
        assert answer.text == workbench_report(web.hub.get(made))
        assert "<h1>&lt;i&gt;</h1>" in answer.text
    finally:
        client.delete(f"/sessions/{made}")


def test_of_a_session_that_is_not_open_there_is_none(client):
    assert client.get("/sessions/nowhere/report").status_code == 404


def test_the_command_line_writes_it_beside_the_session(bench, tmp_path, capsys):
    file, other = tmp_path / "bone.rona", tmp_path / "other.html"
    save_session(bench.session, file)
    assert main(["report", str(file)]) == 0
    assert str(tmp_path / "bone.html") in capsys.readouterr().out
    assert (tmp_path / "bone.html").read_text("utf-8") == workbench_report(bench)
    assert main(["report", str(file), str(other)]) == 0
    assert other.read_bytes() == (tmp_path / "bone.html").read_bytes()
    assert main(["report", str(tmp_path / "absent.rona")]) == 2
    assert "no session file" in capsys.readouterr().err
