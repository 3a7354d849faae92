"""The paper's figures over REST, and the page that shows them."""

import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import httpx2
import pytest

from rona_core.app.paper_figures import style
from rona_core.app.paper_figures.table import PAPER_FIGURES, drawn_figure, lacking
from rona_core.session.document import Session
from rona_ui.api.routes.figures import figures_page
from tests.scenes import demo_parts


@pytest.fixture(scope="module")
def demo(client):
    """The id of a copy of the demo session."""
    made = client.post("/sessions/demo").json()["id"]
    yield made
    client.delete(f"/sessions/{made}")


@pytest.mark.parametrize(
    ("query", "kind", "form"),
    [
        ("", "image/svg+xml", "svg"),
        ("?format=svg", "image/svg+xml", "svg"),
        ("?format=png", "image/png", "png"),
    ],
)
def test_a_figure_is_that_of_the_session(web, client, demo, query, kind, form):
    answer = client.get(f"/sessions/{demo}/figures/registrations{query}")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == kind
    assert f'"figure_04_registrations.{form}"' in answer.headers["content-disposition"]
    assert "script-src" not in answer.headers["content-security-policy"]
    session = web.hub.get(demo).session
    assert answer.content == drawn_figure(session, "registrations", form)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAPER_FIGURES)
def test_every_figure_of_the_demo_session_comes(client, demo, name):
    answer = client.get(f"/sessions/{demo}/figures/{name}?format=png")
    assert answer.content.startswith(b"\x89PNG")


def test_what_is_missing_is_refused_with_the_step(at):
    answer = at("GET", "/figures/reconstruction")
    assert answer.status_code == 409
    assert "Figure 10 needs the maps: compute the maps (step 9)" in answer.json()["detail"]


def test_other_names_and_forms_are_refused(client, demo):
    assert client.get(f"/sessions/{demo}/figures/figure_2").status_code == 404
    assert client.get(f"/sessions/{demo}/figures/joints?format=pdf").status_code == 422
    assert client.get("/sessions/nowhere/figures").status_code == 404


def test_the_page_shows_all_figures_and_runs_no_script(client, demo):
    answer = client.get(f"/sessions/{demo}/figures")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script" not in policy
    assert "<script" not in answer.text
    assert "Devices: virtual." in answer.text
    assert "without ground truth" in answer.text
    titles = re.findall(r"<h2>(.*?)</h2>", answer.text)
    assert titles == [f"Figure {one.number}: {one.title}" for one in PAPER_FIGURES.values()]
    for address in re.findall(r'(?:src|href)="(figures/[^"]+)"', answer.text)[3:6]:
        assert client.get(f"/sessions/{demo}/{address}").status_code == 200, address


def test_the_page_names_the_step_of_each_that_cannot_be_drawn():
    empty = figures_page(Session(name="<b>"), None)
    assert "<img" not in empty
    assert "<h1>&lt;b&gt;</h1>" in empty
    assert "Devices" not in empty
    for figure in PAPER_FIGURES.values():
        assert f"{lacking(figure, Session())}." in empty
    early = figures_page(demo_parts.registered(), "REAL")
    assert re.findall(r'<img src="([^"]+)"', early) == ["figures/registrations"]
    assert "Devices: real." in early


def test_the_schema_lists_figures_and_forms(anonymous, web):
    headers = {"Authorization": f"Bearer {web.token}"}
    paths = anonymous.get("/api/v1/openapi.json", headers=headers).json()["paths"]
    (path,) = (where for where in paths if where.endswith("/figures/{name}"))
    name, form = (
        next(p for p in paths[path]["get"]["parameters"] if p["name"] == wanted)
        for wanted in ("name", "format")
    )
    assert name["schema"]["enum"] == list(PAPER_FIGURES)
    assert form["schema"]["enum"] == list(style.FORMATS)


@pytest.fixture
def held(monkeypatch):
    """Let a figure be drawn until it is released; returns both events and the figures begun."""
    going, release, begun = threading.Event(), threading.Event(), []

    def slow(session, name, form):
        begun.append(name)
        going.set()
        release.wait(30.0)
        return b"<svg/>"

    monkeypatch.setattr("rona_ui.api.routes.figures.drawn_figure", slow)
    yield going, release, begun
    release.set()


def test_those_that_wait_for_a_figure_keep_no_other_waiting(client, demo, held):
    """Six figures are wanted while one is drawn: a short answer comes before that one."""
    going, release, begun = held
    with ThreadPoolExecutor(6) as pool:
        six = [pool.submit(client.get, f"/sessions/{demo}/figures/joints") for _ in range(6)]
        assert going.wait(30.0)
        time.sleep(0.3)  # for the others to arrive
        try:
            assert client.get(f"/sessions/{demo}/steps", timeout=10.0).status_code == 200
            assert len(begun) == 1
        finally:
            release.set()
        assert [one.result().status_code for one in six] == [200] * 6


def test_what_is_not_waited_for_any_more_is_not_drawn(client, demo, held, web):
    going, release, begun = held
    headers = {"Authorization": f"Bearer {web.token}"}
    base = f"http://127.0.0.1:{web.port}/api/v1/sessions/{demo}/figures"
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(client.get, f"/sessions/{demo}/figures/joints")
        assert going.wait(30.0)
        with (
            httpx2.Client(headers=headers, timeout=0.5) as other,
            pytest.raises(httpx2.ReadTimeout),
        ):
            other.get(f"{base}/registrations")
        release.set()
        assert first.result().status_code == 200
    assert client.get(f"/sessions/{demo}/figures/orientations").status_code == 200
    assert begun == ["joints", "orientations"]
