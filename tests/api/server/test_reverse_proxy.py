"""The whole program works under a sub path, whether the proxy takes it off or not."""

import asyncio
import json
import re
from types import SimpleNamespace

import httpx2
import pytest
import viser
import websockets.asyncio.client
import websockets.exceptions

from rona_core.compose import build_registry
from rona_core.errors import InvalidInputError
from rona_ui.resources import static_dir
from rona_ui.server import ServerSettings, address
from rona_ui.viewer.gateway import ViewerGateway
from tests.helpers.api_server import TOKEN, start
from tests.helpers.reverse_proxy import proxied

ROOT = "/rona"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sessions")
    hub, gateway = build_registry(folder, processes=False), ViewerGateway()
    settings = ServerSettings(port=0, sessions=folder, token=TOKEN, root_path=ROOT)
    running, thread, port = start(hub, gateway, settings)
    yield SimpleNamespace(hub=hub, port=port, settings=settings)
    running.should_exit = True
    thread.join(20)
    gateway.close()
    hub.close_all()


@pytest.fixture(params=["prefix stripped", "prefix kept"])
def proxy(request, server):
    with proxied(server.port, ROOT, strip=request.param == "prefix stripped") as running:
        yield running
        assert running.strays == []


@pytest.fixture
def visitor(proxy):
    """A browser that has opened the printed address, as far as httpx is one."""
    with httpx2.Client(base_url=f"http://127.0.0.1:{proxy.port}", timeout=60) as client:
        answer = client.get(f"{ROOT}/", params={"token": TOKEN, "dev": ""})
        assert answer.status_code == 303
        assert answer.headers["location"] == f"{ROOT}/?dev="
        assert "path=/rona/;" in answer.headers["set-cookie"].lower() + ";"
        yield client


def test_page_and_all_that_it_names_is_there(visitor):
    """Follow every address in pages, scripts and styles, as a browser resolves it."""
    seen, wanted = set(), [f"{ROOT}/", f"{ROOT}/session", f"{ROOT}/api/v1/docs"]
    names = re.compile(r"""(?:href|src)="([^"#:]+)"|(?:import|from) "(\.[^"]+)"|url\(([^):]+)\)""")
    while wanted:
        path = wanted.pop()
        if path in seen:
            continue
        seen.add(path)
        answer = visitor.get(path)
        assert answer.status_code == 200, path
        if "/viewer/" in path or "json" in answer.headers["content-type"]:
            continue
        for found in names.findall(answer.text):
            wanted.append(str(answer.url.join("".join(found)).path))
    written = {path.name for path in static_dir().rglob("*.js")}
    assert written <= {path.rpartition("/")[2] for path in seen}
    assert all(path.startswith(f"{ROOT}/") for path in seen)
    assert f"{ROOT}/viewer/" in seen


def test_every_location_can_be_followed(visitor, proxy):
    origin = {"Origin": f"http://127.0.0.1:{proxy.port}"}
    made = visitor.post(f"{ROOT}/api/v1/sessions", headers=origin)
    assert made.status_code == 201
    assert visitor.get(made.headers["location"]).json()["id"] == made.json()["id"]
    jobs = f"{made.headers['location']}/jobs/StartProbeSweep"
    job = visitor.post(jobs, json={"n": 5}, headers=origin)
    assert job.status_code == 202, job.text
    assert visitor.get(job.headers["location"]).json()["id"] == job.json()["id"]
    for path in ("/viewer", "/api/v1/sessions/", "/api/v1/docs/", ""):
        moved = visitor.get(f"{ROOT}{path}")
        if path == "" and proxy.strip:  # the server cannot see that the slash is missing
            continue
        assert moved.status_code in (307, 308), path
        there = moved.headers["location"]
        assert there.startswith(f"{ROOT}/"), there
        assert visitor.get(there).status_code == 200
    visitor.delete(made.headers["location"], headers=origin)


def test_the_description_names_the_sub_path(visitor):
    document = visitor.get(f"{ROOT}/api/v1/openapi.json").json()
    assert document["servers"] == [{"url": ROOT}]
    assert visitor.get(
        ROOT + next(p for p in document["paths"] if p.endswith("/status"))
    ).is_success


def test_a_wrong_method_names_the_right_ones(visitor):
    answer = visitor.put(f"{ROOT}/api/v1/jobs")
    assert (answer.status_code, answer.headers["allow"]) == (405, "GET")


def test_events_stream(visitor):
    with visitor.stream("GET", f"{ROOT}/api/v1/status/events") as stream:
        lines = stream.iter_lines()
        assert next(lines) == "event: status"
        assert json.loads(next(lines).removeprefix("data: "))["program"] == "RONA"


def test_the_viewer_connects(visitor, proxy):
    cookie = "; ".join(f"{name}={value}" for name, value in visitor.cookies.items())

    async def first(path, **headers):
        async with websockets.asyncio.client.connect(
            f"ws://127.0.0.1:{proxy.port}{path}",
            subprotocols=[f"viser-v{viser.__version__}"],
            additional_headers=headers,
            proxy=None,
            max_size=None,
        ) as link:
            return await asyncio.wait_for(link.recv(), 20)

    origin = f"http://127.0.0.1:{proxy.port}"
    for path in ("/rona/viewer", "/rona/viewer/"):
        assert isinstance(asyncio.run(first(path, Cookie=cookie, Origin=origin)), bytes)
    with pytest.raises(websockets.exceptions.InvalidStatus, match="403"):
        asyncio.run(first("/rona/viewer", Cookie=cookie, Origin="http://evil.example"))


def test_a_proxy_that_does_not_keep_host_gets_the_remedy(server):
    with proxied(server.port, ROOT, strip=True, host=f"127.0.0.1:{server.port}") as proxy:
        answer = httpx2.post(
            f"http://127.0.0.1:{proxy.port}{ROOT}/api/v1/sessions",
            headers={
                "Authorization": f"Bearer {TOKEN}",
                "Origin": f"http://127.0.0.1:{proxy.port}",
            },
        )
    assert answer.status_code == 403
    assert "reverse proxy has to pass the Host header on" in answer.json()["detail"]
    with proxied(server.port, ROOT, strip=True, host="lab.example") as proxy:
        answer = httpx2.get(
            f"http://127.0.0.1:{proxy.port}{ROOT}/api/v1/status",
            headers={"Authorization": f"Bearer {TOKEN}", "X-Forwarded-Host": "localhost"},
        )
    assert answer.status_code == 421  # what is forwarded counts for nothing
    for words in ("'lab.example'", "--allow-host", "reverse proxy has to pass the Host header on"):
        assert words in answer.json()["detail"]


def test_it_is_there_without_the_proxy_too(server):
    with httpx2.Client(follow_redirects=True) as client:
        assert client.get(address(server.settings, server.port)).status_code == 200
        answer = client.get(f"http://127.0.0.1:{server.port}{ROOT}/api/v1/status")
        assert answer.status_code == 200


@pytest.mark.parametrize(
    "path", ["rona", "/", "/rona/", "//rona", "/../x", "/a b", "/api", "/viewer/x", "/static", "/ä"]
)
def test_what_is_no_sub_path_is_refused(path):
    with pytest.raises(InvalidInputError, match="--root-path must be the sub path of the proxy"):
        ServerSettings(token="t", root_path=path)


@pytest.mark.parametrize("path", ["", "/rona", "/lab/rona-2", "/~me/a.b", "/apis"])
def test_what_is_a_sub_path_is_taken(path):
    assert ServerSettings(token="t", root_path=path).access.root_path == path
