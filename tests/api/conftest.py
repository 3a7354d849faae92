"""A real server on a free port, with virtual devices and no window, for all tests of the API."""

from types import SimpleNamespace

import httpx2
import pytest

from rona_core.app.runtime import session_registry
from rona_core.compose import build_registry
from rona_core.session.files import load_session
from rona_ui.resources import demo_session
from rona_ui.server import ServerSettings
from rona_ui.viewer.gateway import ViewerGateway
from tests.helpers.api_server import TOKEN, start
from tests.scenes import demo_parts


def loaded(path, *name):
    """Load a session; the demo session is loaded once, as what is computed from it is kept then."""
    return demo_parts.demo() if path == demo_session() else load_session(path, *name)


@pytest.fixture(scope="session", autouse=True)
def demo_loaded_once():
    """Every server of these tests opens copies of the one demo session."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session_registry, "load_session", loaded)
        yield


@pytest.fixture(scope="session")
def web(tmp_path_factory):
    """The server: hub, gateway, port and token."""
    folder = tmp_path_factory.mktemp("sessions")
    hub, gateway = build_registry(folder, processes=False), ViewerGateway()
    settings = ServerSettings(port=0, sessions=folder, token=TOKEN, open_browser=False)
    server, thread, port = start(hub, gateway, settings)
    yield SimpleNamespace(hub=hub, gateway=gateway, port=port, token=TOKEN, folder=folder)
    server.should_exit = True
    thread.join(20)
    gateway.close()
    hub.close_all()


@pytest.fixture(scope="session")
def anonymous(web):
    """A client without a token."""
    with httpx2.Client(base_url=f"http://127.0.0.1:{web.port}", timeout=60) as client:
        yield client


@pytest.fixture(scope="session")
def client(web):
    """A client with the token."""
    headers = {"Authorization": f"Bearer {web.token}"}
    with httpx2.Client(
        base_url=f"http://127.0.0.1:{web.port}/api/v1", headers=headers, timeout=120
    ) as client:
        yield client


@pytest.fixture(scope="session")
def replayed(web, client):
    """Return a function that replays a session as a job and returns what was found."""

    def replay(session_id):
        answer = client.post(f"/sessions/{session_id}/replay")
        assert answer.status_code == 202, answer.text
        job = answer.json()
        assert answer.headers["location"] == f"/api/v1/jobs/{job['id']}"
        web.hub.get(job["session"]).jobs.wait(job["id"], 300)
        job = client.get(f"/jobs/{job['id']}").json()
        assert (job["state"], job["progress"]) == ("done", 1.0), job
        return job["result"]

    return replay


@pytest.fixture
def session(client):
    """A new session; its id."""
    made = client.post("/sessions", json={"name": "test", "seed": 3}).json()
    yield made["id"]
    client.delete(f"/sessions/{made['id']}")


@pytest.fixture
def at(client, session):
    """Return a function that calls a route of the new session."""

    def call(method, path, **rest):
        return client.request(method, f"/sessions/{session}{path}", **rest)

    return call
