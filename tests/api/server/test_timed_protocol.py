"""No connection stays that keeps the server waiting; none ends that the server keeps waiting."""

import json
import socket
import time
from types import SimpleNamespace

import pytest

from rona_core.compose import build_registry
from rona_ui.api import bodies, timed_protocol
from rona_ui.server import ServerSettings
from tests.helpers.api_server import TOKEN, start

LIMITS = {"HEAD_S": 0.6, "BODY_S": 0.8, "BYTES_PER_S": 2000, "UNREAD_S": 0.8, "LOOK_S": 0.05}
PATIENCE_S = 30.0
STATUS = f"GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {TOKEN}\r\n\r\n"
POST = (
    f"POST /api/v1/sessions/current/uploads?name=a.bin HTTP/1.1\r\nHost: localhost\r\n"
    f"Authorization: Bearer {TOKEN}\r\n"
)
STRANGER = "POST /api/v1/sessions HTTP/1.1\r\nHost: localhost\r\n"
LENGTH = "Content-Length: 1000\r\n\r\n"
CHUNKED = "Transfer-Encoding: chunked\r\n\r\n"


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """A server with short limits."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in LIMITS.items():
            patch.setattr(timed_protocol, name, value)
        folder = tmp_path_factory.mktemp("sessions")
        hub = build_registry(folder, processes=False)
        hub.create("here", 1)
        settings = ServerSettings(port=0, sessions=folder, token=TOKEN, open_browser=False)
        server, thread, port = start(hub, None, settings)
        yield SimpleNamespace(server=server, port=port, folder=folder)
        server.should_exit = True
        thread.join(20)
        hub.close_all()


def connected(port):
    made = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
    made.settimeout(PATIENCE_S)
    return made


def to_the_end(made, sent=b""):
    """Return all that comes until the server closes; sends a byte of ``sent`` now and then."""
    got, end = b"", time.monotonic() + PATIENCE_S
    made.settimeout(0.1)
    while time.monotonic() < end:
        try:
            part = made.recv(1 << 16)
        except TimeoutError:
            if sent:
                made.sendall(sent[:1])
                sent = sent[1:]
            continue
        except ConnectionResetError:
            return got
        if not part:
            return got
        got += part
    raise AssertionError(f"open after {PATIENCE_S} s: {got[-300:]!r}")


def left(server):
    """Return how many connections the server still has, once it has had the time to end them."""
    end = time.monotonic() + PATIENCE_S
    while server.server_state.connections and time.monotonic() < end:
        time.sleep(0.02)
    return len(server.server_state.connections)


SLOW = b"x" * 10_000  # a byte every 0.1 s
WAITING = {  # what is sent at once, what is sent a byte at a time, whether 408 is to be seen
    "nothing": ("", b"", False),
    "half a request line": ("GET /api", b"", True),
    "half a header": (STATUS[:40], b"", True),
    "headers without an end": (STATUS[:-4] + "\r\nX-Slow: ", SLOW, True),
    "empty lines": ("", b"\r\n" * 5000, False),
    "no body": (POST + LENGTH, b"", True),
    "half a body": (POST + LENGTH + 500 * "x", b"", True),
    "a slow body": (POST + LENGTH, SLOW, True),
    "a body without a chunk": (POST + CHUNKED, b"", True),
    "half a chunk": (POST + CHUNKED + "3e8\r\nxxx", b"", True),
    "slow chunks": (POST + CHUNKED + "3e8\r\n", SLOW, True),
    "a second request of half a header": (STATUS, STATUS[:5].encode(), True),
    "a second request without a body": (STATUS + POST + LENGTH, b"", True),
    "a slow body after a refusal": (STRANGER + LENGTH, SLOW, False),
    "no more after an answer": (STATUS, b"", False),
}


@pytest.mark.sweep(5)
@pytest.mark.parametrize("name", WAITING)
def test_who_keeps_the_server_waiting_is_let_go(quick, name):
    at_once, slowly, answered = WAITING[name]
    with connected(quick.port) as made:
        made.sendall(at_once.encode())
        got = to_the_end(made, slowly)
    assert (b"HTTP/1.1 408 " in got) == answered, got
    if answered:
        told = json.loads(got.rpartition(b"\r\n\r\n")[2])
        assert (told["status"], told["code"]) == (408, "timeout")
        assert "send" in told["detail"]
    assert left(quick.server) == 0
    assert not list((quick.folder / ".uploads").glob(".upload.*"))


def test_who_does_not_read_the_answer_is_let_go(quick):
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect(("127.0.0.1", quick.port))
    made.settimeout(PATIENCE_S)
    with made:
        made.sendall(STATUS.replace("status", "openapi.json").encode() * 100)
        assert left(quick.server) == 0


def test_all_at_once_go_and_others_are_answered_meanwhile(quick):
    waiting = [connected(quick.port) for _ in range(60)]
    for number, made in enumerate(waiting):
        made.sendall(("", STATUS[:40], POST + LENGTH)[number % 3].encode())
    with connected(quick.port) as made:
        request = STATUS.replace("GET /api/v1/status", "POST /api/v1/sessions/current/robot/stop")
        made.sendall(request.encode())
        assert made.recv(1 << 16).startswith(b"HTTP/1.1 200 ")
    assert left(quick.server) == 0
    for made in waiting:
        made.close()


# -- what must not end -----------------------------------------------------------------------------


def test_a_body_may_take_longer_than_its_limit_if_it_comes_fast_enough(quick):
    parts, size = 20, 1000  # twice as fast as it must be, for three times the limit
    with connected(quick.port) as made:
        made.sendall(f"{POST}Content-Length: {parts * size}\r\n\r\n".encode())
        for _ in range(parts):
            time.sleep(0.12)
            made.sendall(size * b"x")
        assert made.recv(1 << 16).startswith(b"HTTP/1.1 201 ")


def test_an_event_stream_stays(quick):
    with connected(quick.port) as made:
        made.sendall(STATUS.replace("status", "status/events").encode())
        made.settimeout(0.2)
        got, end = b"", time.monotonic() + 5 * max(LIMITS["HEAD_S"], LIMITS["BODY_S"])
        while time.monotonic() < end:
            try:
                part = made.recv(1 << 16)
            except TimeoutError:
                continue
            assert part
            got += part
    assert b"event: status" in got


def test_what_the_server_itself_is_slow_at_does_not_count(quick, monkeypatch):
    genuine = bodies.open_temporary

    def late(path):
        time.sleep(3 * LIMITS["BODY_S"])
        return genuine(path)

    monkeypatch.setattr(bodies, "open_temporary", late)
    with connected(quick.port) as made:  # the body waits for 100 and the answer for the disk
        made.sendall((POST + "Expect: 100-continue\r\n" + LENGTH).encode())
        assert made.recv(1 << 16).startswith(b"HTTP/1.1 100 ")
        made.sendall(1000 * b"x")
        assert made.recv(1 << 16).startswith(b"HTTP/1.1 201 ")


def test_no_part_of_an_answer_waits_for_an_acknowledgement(quick):
    with connected(quick.port) as made:
        made.sendall(STATUS.encode())
        assert made.recv(1 << 16).startswith(b"HTTP/1.1 200")
        (served,) = quick.server.server_state.connections
        inside = served.transport.get_extra_info("socket")
        assert inside.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    assert left(quick.server) == 0
