"""Nobody gets in by another name, from another page, without the token, or by the back door."""

import asyncio
import gzip
import http.client
import threading

import httpx2
import msgspec
import pytest
import viser
import websockets.asyncio.client
import websockets.asyncio.server
import websockets.exceptions

from rona_core.compose import build_registry
from rona_core.errors import DeviceError, InvalidInputError
from rona_ui.api.access_guard import is_loopback
from rona_ui.server import ServerSettings, address, has_display
from rona_ui.viewer import gateway as gateway_module
from rona_ui.viewer.gateway import SECRET_HEADER, TESTED, ViewerGateway
from tests.helpers.api_server import TOKEN, start

PROTOCOL = f"viser-v{viser.__version__}"
CURRENT = "/api/v1/status"


@pytest.fixture
def known(web):
    return {"Authorization": f"Bearer {web.token}"}


@pytest.fixture
def cookie(anonymous, web):
    """The cookie that the printed address gives, as it is sent back."""
    anonymous.cookies.clear()
    answer = anonymous.get("/", params={"token": web.token})
    anonymous.cookies.clear()
    return answer.headers["set-cookie"].split(";")[0]


@pytest.mark.parametrize(
    "token", ["", "wrong", "a-token-of-the-test", "ä", "a-token-of-the-tests2"]
)
def test_a_wrong_token_is_refused(anonymous, cookie, token):
    sent = f"{cookie.partition('=')[0]}={token}"
    for name, text in (("Authorization", f"Bearer {token}"), ("Cookie", sent)):
        headers = {name: text.strip().encode()}
        answer = anonymous.get(CURRENT, headers=headers)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
    assert anonymous.get(CURRENT, params={"token": token}).status_code == 401


def test_the_printed_address_gives_a_cookie_and_a_clean_address(anonymous, web):
    answer = anonymous.get("/", params={"token": web.token, "fixedDpr": "0.5"})
    assert (answer.status_code, answer.headers["location"]) == (303, "/?fixedDpr=0.5")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    value = answer.headers["set-cookie"].split(";")[0]
    anonymous.cookies.clear()
    assert anonymous.get(CURRENT, headers={"Cookie": value}).status_code == 200
    assert anonymous.get(CURRENT, headers={"Cookie": f"other=1; {value}"}).status_code == 200


def test_the_cookie_is_not_the_token_and_opens_this_server_alone(anonymous, cookie, web, tmp_path):
    name, _, value = cookie.partition("=")
    assert name == f"rona_{web.port}"
    assert len(value) >= 32
    assert web.token not in cookie
    assert anonymous.get(CURRENT, headers={"Cookie": f"{name}={web.token}"}).status_code == 401
    bearer = {"Authorization": f"Bearer {value}"}
    assert anonymous.get(CURRENT, headers=bearer).status_code == 401
    assert anonymous.get("/", params={"token": value}).status_code == 401
    # a browser sends it to every port of this machine: another server learns no token by it, has
    # another name for its own, and does not take it
    hub = build_registry(tmp_path, processes=False)
    other, thread, port = start(hub, None, ServerSettings(port=0, sessions=tmp_path, token=TOKEN))
    for sent in (cookie, f"rona_{port}={value}"):
        answer = httpx2.get(f"http://127.0.0.1:{port}{CURRENT}", headers={"Cookie": sent})
        assert answer.status_code == 401
    forwarded = {"Host": "localhost:7000"}  # as through SSH: named as the browser has it
    answer = anonymous.get("/", params={"token": web.token}, headers=forwarded)
    assert answer.headers["set-cookie"].startswith("rona_7000=")
    other.should_exit = True
    thread.join(20)
    hub.close_all()


@pytest.mark.ci
def test_a_page_stays_signed_in_while_its_server_is_started_again(tmp_path):
    """As long as the token is the same; the value of the cookie ends with the token."""

    def answers(token, sent):
        hub = build_registry(tmp_path, processes=False)
        settings = ServerSettings(port=0, sessions=tmp_path, token=token)
        server, thread, port = start(hub, None, settings)
        address = f"http://127.0.0.1:{port}"
        welcome = httpx2.get(address, params={"token": token})
        value = welcome.headers["set-cookie"].partition("=")[2].partition(";")[0]
        cookie = {"Cookie": f"rona_{port}={sent or value}"}
        status = httpx2.get(f"{address}/api/v1/sessions", headers=cookie).status_code
        server.should_exit = True
        thread.join(20)
        hub.close_all()
        return value, status

    value, status = answers(TOKEN, None)
    assert status == 200
    assert (tmp_path / ".cookie_secret").stat().st_mode & 0o077 == 0
    assert answers(TOKEN, value) == (value, 200)
    assert answers(f"{TOKEN}2", value)[1] == 401


def test_the_token_leads_to_no_other_site(web):
    connection = http.client.HTTPConnection("127.0.0.1", web.port, timeout=20)
    connection.request("GET", f"//evil.example/?token={web.token}")
    answer = connection.getresponse()
    connection.close()
    assert answer.status == 303
    assert answer.headers["location"] == "/evil.example/"


def test_a_token_in_the_address_changes_nothing(anonymous, web):
    answer = anonymous.post(f"/api/v1/sessions?token={web.token}")
    assert answer.status_code == 401


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "localhost.evil", "[::2]"]
)
def test_other_host_names_are_refused(anonymous, known, host):
    answer = anonymous.get(CURRENT, headers={**known, "Host": host})
    assert (answer.status_code, answer.json()["code"]) == (421, "misdirected")
    assert "--allow-host" in answer.json()["detail"]


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:1", "[::1]:8642", "LOCALHOST:2"])
def test_names_of_this_machine_are_answered(anonymous, known, host):
    assert anonymous.get(CURRENT, headers={**known, "Host": host}).status_code == 200


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "http://127.0.0.1:1",
        "file://127.0.0.1",
        "",
        "http://[",
        "//[",
    ],
)
def test_pages_of_other_origins_change_nothing(anonymous, known, web, origin):
    before = len(web.hub.ids())
    answer = anonymous.post("/api/v1/sessions", headers={**known, "Origin": origin})
    assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")
    assert len(web.hub.ids()) == before


def test_our_own_page_may_change_things(anonymous, known, web):
    origin = f"http://127.0.0.1:{web.port}"
    answer = anonymous.post("/api/v1/sessions", headers={**known, "Origin": origin})
    assert answer.status_code == 201
    anonymous.delete(f"/api/v1/sessions/{answer.json()['id']}", headers=known)


@pytest.mark.parametrize("site", ["cross-site", "same-site", "Cross-Site", "nonsense"])
def test_pages_of_other_sites_change_nothing_even_without_an_origin(anonymous, known, web, site):
    sessions = web.hub.ids()
    answer = anonymous.post("/api/v1/sessions", headers={**known, "Sec-Fetch-Site": site})
    assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")
    assert web.hub.ids() == sessions
    assert anonymous.get(CURRENT, headers={**known, "Sec-Fetch-Site": site}).status_code == 200


@pytest.mark.parametrize("site", ["same-origin", "none"])
def test_our_own_page_and_the_address_bar_may_change(client, site):
    made = client.post("/sessions", headers={"Sec-Fetch-Site": site})
    assert made.status_code == 201
    client.delete(f"/sessions/{made.json()['id']}")


def test_no_other_origin_may_read(anonymous, known):
    answer = anonymous.get(CURRENT, headers={**known, "Origin": "http://evil.example"})
    assert not [name for name in answer.headers if name.startswith("access-control")]
    assert answer.headers["cross-origin-resource-policy"] == "same-origin"


# -- websockets ------------------------------------------------------------------------------------


def connect(port, path="/viewer", protocol=PROTOCOL, **headers):
    """Connect a websocket; return the first message, or the status of the refusal."""

    async def go():
        try:
            async with websockets.asyncio.client.connect(
                f"ws://127.0.0.1:{port}{path}",
                subprotocols=[protocol] if protocol else None,
                additional_headers=headers,
                proxy=None,
                max_size=None,
            ) as socket:
                assert socket.subprotocol == protocol
                return await asyncio.wait_for(socket.recv(), 20)
        except websockets.exceptions.InvalidStatus as error:
            return error.response.status_code

    return asyncio.run(go())


@pytest.mark.parametrize("path", ["/viewer", "/viewer/"])
def test_the_viewer_answers_through_the_relay(web, known, cookie, path):
    origin = f"http://127.0.0.1:{web.port}"
    assert isinstance(connect(web.port, path, Origin=origin, **known), bytes)
    assert isinstance(connect(web.port, path, Origin=origin, Cookie=cookie), bytes)


def test_a_websocket_is_refused_to_strangers(web, known):
    assert connect(web.port) == 403
    assert connect(web.port, Authorization="Bearer wrong") == 403
    assert connect(web.port, path=f"/viewer?token={web.token}") == 403
    assert connect(web.port, Origin="http://evil.example", **known) == 403
    assert connect(web.port, Origin="null", **known) == 403
    assert connect(web.port, protocol=None, **known) == 403


def test_messages_go_both_ways_and_who_leaves_is_forgotten(web, known):
    camera = {
        "type": "ViewerCameraMessage",
        "wxyz": (1.0, 0.0, 0.0, 0.0),
        "position": (0.0, 0.0, 3.0),
        "fov": 1.0,
        "near": 0.01,
        "far": 10.0,
        "image_height": 600,
        "image_width": 800,
        "look_at": (0.0, 0.0, 0.0),
        "up_direction": (0.0, 0.0, 1.0),
    }
    viewer, come, gone = web.gateway.server, threading.Event(), threading.Event()
    viewer.on_client_connect(lambda client: come.set())
    viewer.on_client_disconnect(lambda client: gone.set())

    async def go():
        async with websockets.asyncio.client.connect(
            f"ws://127.0.0.1:{web.port}/viewer",
            subprotocols=[PROTOCOL],
            additional_headers=known,
            proxy=None,
            max_size=None,
        ) as socket:
            assert await asyncio.wait_for(socket.recv(), 20)
            await socket.send(msgspec.msgpack.encode(camera))
            assert await asyncio.to_thread(come.wait, 20)
            assert [client.camera.position[2] for client in viewer.get_clients().values()] == [3.0]

    asyncio.run(go())
    assert gone.wait(20)
    assert viewer.get_clients() == {}


def test_a_page_that_sends_no_camera_is_to_connect_again(web, known, monkeypatch):
    monkeypatch.setattr(gateway_module, "FIRST_MESSAGE_S", 0.2)

    async def go():
        async with websockets.asyncio.client.connect(
            f"ws://127.0.0.1:{web.port}/viewer",
            subprotocols=[PROTOCOL],
            additional_headers=known,
            proxy=None,
            max_size=None,
        ) as socket:
            async with asyncio.timeout(20):
                async for _ in socket:
                    pass
            return socket.close_code

    assert asyncio.run(go()) == 1001


# -- the seam: what the gateway knows of viser -----------------------------------------------------


def test_this_version_of_viser_is_known():
    assert viser.__version__ in TESTED


def test_the_hidden_port_lets_nobody_in(web):
    assert connect(web.gateway.port) == 403
    assert connect(web.gateway.port, **{SECRET_HEADER: "guess"}) == 403
    secret = web.gateway._secret
    assert isinstance(connect(web.gateway.port, **{SECRET_HEADER: secret}), bytes)


def test_the_hidden_port_serves_no_page(web):
    assert httpx2.get(f"http://127.0.0.1:{web.gateway.port}/").status_code == 403


def test_the_viewer_cannot_be_shared_with_the_world(web):
    assert web.gateway.server.request_share_url() is None


def test_a_viser_that_starts_otherwise_is_not_used(monkeypatch):
    class Other:
        stopped = False

        def __init__(self, **_):
            pass

        def stop(self):
            Other.stopped = True

    monkeypatch.setattr(gateway_module.viser, "ViserServer", Other)
    with pytest.raises(DeviceError, match="could not be closed"):
        ViewerGateway()
    assert Other.stopped


def test_a_page_of_viser_made_otherwise_is_not_used(monkeypatch):
    genuine = gateway_module.Path.read_bytes
    for spoilt in (b"<script ", b'e.type="module";'):
        monkeypatch.setattr(
            gateway_module.Path,
            "read_bytes",
            lambda path, spoilt=spoilt: genuine(path).replace(spoilt, b"?"),
        )
        with pytest.raises(DeviceError, match="could not be restricted to its own scripts"):
            gateway_module._page_with("n")


def test_viser_prints_nothing_and_leaves_websockets_as_they_were(capfd):
    genuine = websockets.asyncio.server.serve
    gateway = ViewerGateway()
    gateway.close()
    gateway.close()
    assert websockets.asyncio.server.serve is genuine
    assert capfd.readouterr() == ("", "")


def test_the_viewers_page_is_compressed_and_cached(anonymous, known):
    plain = anonymous.get("/viewer/", headers={**known, "Accept-Encoding": "identity"})
    assert plain.status_code == 200
    assert plain.headers["x-content-type-options"] == "nosniff"
    assert plain.headers["cache-control"] == "no-cache"
    assert plain.content.startswith(b"<!doctype html>")
    with anonymous.stream(
        "GET", "/viewer/", headers={**known, "Accept-Encoding": "gzip"}
    ) as zipped:
        assert zipped.headers["content-encoding"] == "gzip"
        assert gzip.decompress(b"".join(zipped.iter_raw())) == plain.content
    tag = plain.headers["etag"]
    again = anonymous.get("/viewer/", headers={**known, "If-None-Match": tag})
    assert (again.status_code, again.content) == (304, b"")
    other = anonymous.get("/viewer/", headers={**known, "If-None-Match": '"other"'})
    assert other.status_code == 200
    assert anonymous.get("/viewer", headers=known).headers["location"] == "/viewer/"


PAGES = ("/", "/session", "/viewer/", "/api/v1/docs", "/favicon.ico", "/static/icon.svg")


@pytest.mark.parametrize("path", [*PAGES, "/nowhere", CURRENT, "/static/page/main.js"])
def test_nothing_runs_or_frames_what_is_not_ours(anonymous, known, path):
    """No answer lets a browser run what was written into it, or load from elsewhere."""
    answer = anonymous.get(path, headers=known)
    rules = answer.headers["content-security-policy"].split("; ")
    policy = {rule.partition(" ")[0]: rule.split()[1:] for rule in rules}
    scripts = policy.get("script-src", policy["default-src"])
    assert not {"'unsafe-inline'", "*", "data:", "blob:", "http:", "https:"} & set(scripts)
    assert ("'unsafe-eval'" in scripts) == (path == "/viewer/")  # only code that runs can use it
    assert policy["default-src"] in (["'none'"], ["'self'"])
    assert policy["frame-ancestors"] == ["'self'"]
    for sources in policy.values():
        assert all("." not in source and "*" not in source for source in sources)
    for nonce in (word[7:-1] for word in scripts if word.startswith("'nonce-")):
        assert len(nonce) >= 20
        assert answer.text.count(nonce) == 2  # viser's page: its script, and the one that unpacks


# -- settings --------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "127.8.8.8"])
def test_without_a_token_only_on_this_machine(host):
    assert is_loopback(host)
    assert ServerSettings(host=host, token=None).access.token is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.2", "example.org", ""])
def test_a_token_is_needed_where_others_can_connect(host):
    assert not is_loopback(host)
    with pytest.raises(InvalidInputError, match="--no-auth"):
        ServerSettings(host=host, token=None)
    assert ServerSettings(host=host, token="x").access.token == "x"


def test_the_token_comes_from_the_environment_or_from_chance(monkeypatch):
    monkeypatch.setenv("RONA_TOKEN", "mine")
    assert ServerSettings().token == "mine"
    monkeypatch.setenv("RONA_TOKEN", "")
    tokens = {ServerSettings().token for _ in range(5)}
    assert len(tokens) == 5
    assert min(map(len, tokens)) >= 32


def test_the_address_can_be_opened():
    assert address(ServerSettings(host="0.0.0.0", token="t"), 5) == "http://127.0.0.1:5/?token=t"
    assert address(ServerSettings(host="::1", token=None), 5) == "http://[::1]:5/"


def test_further_hosts_are_allowed_by_name():
    hosts = ServerSettings(host="0.0.0.0", allow_hosts=("lab.example",), token="t").access.hosts
    assert "lab.example" in hosts
    assert "0.0.0.0" not in hosts


def test_no_browser_is_opened_without_a_display(monkeypatch):
    monkeypatch.setattr("rona_ui.server.shutil.which", lambda name: None)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not has_display()
    monkeypatch.setenv("DISPLAY", ":0")
    assert has_display()
