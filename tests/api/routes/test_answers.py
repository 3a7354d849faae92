"""Answers over REST: none is large JSON, arrays are bytes, nothing holds the event loop."""

import asyncio
import gzip
import inspect
import io
import json
from itertools import pairwise

import numpy as np
import pytest
from fastapi import APIRouter
from fastapi.routing import APIRoute

from rona_core.app.declarations.registry import REGISTRY
from rona_ui.api.answers import LEAST_PACKED, LONGEST_ARRAY, PIECE, InPieces, plain
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.routes import devices, events, files, jobs, procedure, results, sessions
from rona_ui.server import PREFIX

LARGEST_JSON = 1_000_000  # bytes, of any answer about the demo session
ENDLESS = ("/events", "/stream")
# what waits for the network in the event loop, and does all else in threads
ASYNCHRONOUS = {
    "upload_session",
    "upload_specimen",
    "compare_with_reference",
    "keep_picture",
    "stop",
    "session_events",
    "status_events",
    "job_events",
    "stream_state",
    "stream_frames",
}


@pytest.fixture(scope="module")
def demo(client):
    opened = client.post("/sessions/demo").json()["id"]
    yield opened
    client.delete(f"/sessions/{opened}")


def asked(client, demo):
    """Yield the address of everything that can be read about the demo."""
    parts = {"session_id": demo, "name": "maps.zip", "ordinal": 1, "job_id": "x", "file": "x"}
    for path, verbs in client.get("/openapi.json").json()["paths"].items():
        if "get" not in verbs or path.endswith((*ENDLESS, "/array")):
            continue
        if "application/json" not in verbs["get"]["responses"]["200"].get("content", {}):
            continue
        for step in REGISTRY.step_names if "results/{step}" in path else ("tool", "pointer"):
            for scan in ("first", "second"):
                yield path.removeprefix(PREFIX).format(step=step, scan=scan, number=7, **parts)


def references(value):
    """Yield every array that stands in JSON as a reference."""
    if isinstance(value, dict):
        if "npy" in value:
            yield value
        for item in value.values():
            yield from references(item)
    elif isinstance(value, list):
        for item in value:
            yield from references(item)


@pytest.mark.ci
def test_no_json_about_the_demo_is_large(client, demo):
    seen = 0
    for path in sorted(set(asked(client, demo))):
        answer = client.get(path)
        if "json" in answer.headers["content-type"] and path != "/openapi.json":
            assert len(answer.content) < LARGEST_JSON, path
            seen += answer.status_code == 200
    assert seen >= 30


@pytest.mark.sweep(3)
@pytest.mark.parametrize("step", REGISTRY.step_names)
def test_every_array_that_is_not_in_json_is_at_the_address_that_stands_there(client, demo, step):
    address = f"/sessions/{demo}/results/{step}"
    found = list(references(client.get(address).json()))
    for each in found:
        answer = client.get(f"/sessions/{demo}/results/{each['npy']}")
        assert answer.status_code == 200, each
        array = np.load(io.BytesIO(answer.content), allow_pickle=False)
        assert list(array.shape) == each["shape"]
        assert array.dtype.name == each["dtype"]
        assert array.size > LONGEST_ARRAY
    assert bool(found) == (step != "setup")


def test_rf_comes_as_it_was_recorded(client, demo, web):
    scans = web.hub.get(demo).session.captures.scan.scans
    address = f"/sessions/{demo}/results/scan/array"
    sent = client.get(address, params={"at": "/captures/scan/value/scans/rf"})
    array = np.load(io.BytesIO(sent.content))
    assert array.dtype == scans.rf.dtype == np.float32
    np.testing.assert_array_equal(array, scans.rf)
    assert len(sent.content) < scans.rf.nbytes + 200
    assert sent.headers["content-encoding"] == "gzip"  # a converter of 12 bits made it
    assert int(sent.headers["content-length"]) < 0.7 * scans.rf.nbytes


def test_poses_and_short_arrays_have_an_address_too(client, demo, web):
    held = web.hub.get(demo).session.captures.tool.marker.Ts_tracker_marker
    address = f"/sessions/{demo}/results/tool/array"
    at = "/captures/tool/value/marker/Ts_tracker_marker"
    for name, array in (("wxyz", held.wxyz()), ("translations_mm", held.translations)):
        sent = client.get(address, params={"at": f"{at}/{name}"}).content
        np.testing.assert_array_equal(np.load(io.BytesIO(sent)), array)


@pytest.mark.parametrize(
    ("at", "status"),
    [
        ("/captures/scan/value/scans", 404),
        ("/captures/scan/value/scans/rf/0", 404),
        ("/captures/scan/value/scans/__class__", 404),
        ("/captures/none", 404),
        ("/results", 404),
        ("/", 404),
        ("/captures/scan/value/99999999999999999999", 404),
        ("captures", 422),
        ("/" + "x" * 501, 422),
    ],
)
def test_where_there_is_no_array_the_answer_says_so(client, demo, at, status):
    answer = client.get(f"/sessions/{demo}/results/scan/array", params={"at": at})
    assert answer.status_code == status, answer.text


def test_thinned_points_are_lists(client, demo):
    held = client.get(f"/sessions/{demo}/results/surface?max_points=300").json()
    points = held["results"]["surface"]["value"]["points_base"]
    assert (len(points), len(points[0])) == (300, 3)


@pytest.mark.parametrize("size", [LONGEST_ARRAY, LONGEST_ARRAY + 1])
def test_an_array_is_a_list_up_to_the_limit(size):
    made = plain({"a/b": [np.arange(size)]}, None, "scan/array?at=")
    if size <= LONGEST_ARRAY:
        assert made == {"a/b": [list(range(size))]}
    else:
        expected = {"shape": [size], "dtype": "int64", "npy": "scan/array?at=/a~1b/0"}
        assert made == {"a/b": [expected]}


def test_numbers_that_are_none_are_null():
    assert plain([np.array([1.0, np.nan, -np.inf]), np.float64("nan")]) == [[1.0, None, None], None]


# -- in pieces, and packed where it pays -----------------------------------------------------------


def sent_of(body, accept="gzip", more=(), headers=()):
    """Return the messages of an answer that goes through ``InPieces``, and the turns of others."""

    async def app(scope, receive, send):
        length = [(b"content-length", str(len(body)).encode())] if not more else []
        start = {"type": "http.response.start", "status": 200, "headers": [*length, *headers]}
        await send(start)
        await send({"type": "http.response.body", "body": body, "more_body": bool(more)})
        for number, part in enumerate(more, start=1):
            last = number == len(more)
            await send({"type": "http.response.body", "body": part, "more_body": not last})

    async def run():
        sent, turns = [], 0

        async def send(message):
            sent.append((message, turns))

        async def other():
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        task = asyncio.create_task(other())
        scope = {"type": "http", "headers": [(b"accept-encoding", accept.encode())]}
        await InPieces(app)(scope, None, send)
        task.cancel()
        return sent

    (start, _), *bodies = asyncio.run(run())
    return dict(start["headers"]), bodies


@pytest.mark.parametrize("size", [0, 1, PIECE, PIECE + 1, 3 * PIECE + 5])
def test_a_large_answer_goes_out_in_pieces_between_which_others_have_a_turn(size):
    body = np.random.default_rng(size).bytes(size)
    headers, bodies = sent_of(body)
    assert b"".join(message["body"] for message, _ in bodies) == body
    assert headers[b"content-length"] == str(size).encode()
    assert all(len(message["body"]) <= PIECE for message, _ in bodies)
    assert [message["more_body"] for message, _ in bodies] == [True] * (len(bodies) - 1) + [False]
    turns = [turn for _, turn in bodies]
    assert all(a < b for a, b in pairwise(turns))


def test_what_shrinks_is_packed_for_who_takes_it():
    text = json.dumps(list(range(100_000))).encode()
    headers, bodies = sent_of(text)
    packed = b"".join(message["body"] for message, _ in bodies)
    assert gzip.decompress(packed) == text
    assert len(packed) < 0.5 * len(text)
    assert headers[b"content-encoding"] == b"gzip"
    assert headers[b"content-length"] == str(len(packed)).encode()
    assert headers[b"vary"] == b"Accept-Encoding"
    noise = np.random.default_rng(1).bytes(len(text))
    short, coded = text[:LEAST_PACKED], [(b"content-encoding", b"br")]
    for body, accept, given in ((text, "", ()), (noise, "gzip", ()), (short, "gzip", ())):
        headers, bodies = sent_of(body, accept, headers=given)
        assert b"content-encoding" not in headers
        assert b"".join(message["body"] for message, _ in bodies) == body
    headers, bodies = sent_of(text, "gzip", headers=coded)
    assert headers[b"content-encoding"] == b"br"
    assert b"".join(message["body"] for message, _ in bodies) == text


def test_what_comes_bit_by_bit_is_handed_on_as_it_comes():
    headers, bodies = sent_of(b"a" * 200_000, more=(b"b", b""))
    assert [len(message["body"]) for message, _ in bodies] == [200_000, 1, 0]
    assert b"content-encoding" not in headers


def test_a_stream_is_open_before_its_first_event():
    async def run():
        sent, opened = [], asyncio.Event()

        async def app(scope, receive, send):
            await send({"type": "http.response.start", "status": 200, "headers": []})
            assert [message["type"] for message in sent] == ["http.response.start"]
            opened.set()

        async def send(message):
            sent.append(message)

        await InPieces(app)({"type": "http", "headers": []}, None, send)
        return opened.is_set()

    assert asyncio.run(run())


# -- nothing is computed in the event loop ---------------------------------------------------------


def test_every_route_answers_from_a_thread():
    parts = (sessions, files, jobs, results, procedure, devices, events)
    values = [value for part in parts for value in vars(part).values()]
    routers = [value for value in values if isinstance(value, APIRouter)]
    routers += [jobs.declared_commands(), jobs.declared_jobs()]
    routes = [route for router in routers for route in router.routes]
    assert len(routes) > 100
    for route in routes:
        assert isinstance(route, APIRoute)
        assert type(route) is BodyRoute, route.path
        waits = inspect.iscoroutinefunction(route.endpoint)
        assert waits == (route.endpoint.__name__ in ASYNCHRONOUS), route.path
