"""Bodies over REST: bounded by route, lists by length, few errors, no key twice: a sweep."""

import json
import socket
from dataclasses import dataclass
from typing import Literal, get_args, get_origin, get_type_hints

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.saving.session_files import MAX_UPLOAD_BYTES
from rona_core.devices.limits import INNER, limits_of
from rona_ui.api.bodies import BODY_BYTES, body_bytes, parsed
from rona_ui.api.problems import MOST_ERRORS
from rona_ui.server import PREFIX
from tests.api.routes.test_exact_bodies import IN_SESSION, ROUTES

JSON = {"Content-Type": "application/json"}
SMALL_BYTES = 12_000  # of a refusal
MESSAGES = REGISTRY.command_types | REGISTRY.activity_types
EACH_ROUTE = pytest.mark.parametrize(
    ("method", "path", "kind"), ROUTES, ids=lambda value: getattr(value, "__name__", value)
)
PARTS = {"step": "tool", "name": "pointer6d", "ordinal": 1, "scan": "first", "number": 0}
PARTS |= {"job_id": "x", "key": "x", "file": "x", "session_id": "current"}


def operations(client):
    for path, verbs in client.get("/openapi.json").json()["paths"].items():
        for verb, operation in verbs.items():
            yield verb.upper(), path.format(**PARTS), operation


def head_alone(web, method, path, length):
    """Send the head of a request that announces a body, none of it, and return the answer."""
    head = (
        f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{web.port}\r\n"
        f"Authorization: Bearer {web.token}\r\nContent-Type: application/json\r\n"
        f"Content-Length: {length}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", web.port), timeout=60) as wire:
        wire.sendall(head.encode())
        return wire.recv(4096).decode()


def test_a_body_over_the_limit_of_its_route_is_refused_before_it_is_sent(client, web, session):
    client.post(f"/sessions/{session}/commands/SetSeed", json={"seed": 9})
    before = client.get(f"/sessions/{session}").json()
    for method, path, operation in operations(client):
        raw = "application/octet-stream" in operation.get("requestBody", {}).get("content", {})
        limit = MAX_UPLOAD_BYTES if raw else BODY_BYTES
        if kind := MESSAGES.get(operation["operationId"]):
            limit = body_bytes(kind)
            assert limit <= 1_400_000, "no list of a message needs more"
        for length in (limit + 1, 10**12):
            answer = head_alone(web, method, path, length)
            assert answer.startswith("HTTP/1.1 413 "), (method, path, answer)
            assert '"too_large"' in answer or "\r\n\r\n" in answer
    assert client.get(f"/sessions/{session}").json() == before  # nor was anything done first


@pytest.mark.sweep(12)
@EACH_ROUTE
def test_a_body_without_a_length_is_cut_off_at_the_limit(client, session, method, path, kind):
    limit = body_bytes(kind) if kind in MESSAGES.values() and "/robot" not in path else BODY_BYTES

    def pieces():
        yield b'{"x": "'
        yield b"x" * limit

    answer = client.request(method, path.format(session), content=pieces(), headers=JSON)
    assert (answer.status_code, answer.json()["code"]) == (413, "too_large")


def longest(hint, words):
    """Return a value with lists as long as they may be, of the longest numbers and names."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is tuple and Ellipsis in arguments:
        return [longest(arguments[0], words.get(INNER, {}))] * words["maxItems"]
    if origin is tuple:
        return [longest(part, {}) for part in arguments]
    if origin is Literal:
        return max(arguments, key=len)
    if arguments:  # a union
        return max((longest(part, words) for part in arguments), key=lambda v: len(json.dumps(v)))
    return {float: -1.2345678901234567e-300, int: 10**9 - 1, str: "n" * 240}.get(hint)


@pytest.mark.parametrize("kind", MESSAGES.values(), ids=MESSAGES)
def test_the_longest_body_of_a_message_fits_its_route(kind):
    limits = limits_of(kind)
    hints = get_type_hints(kind)
    body = {name: longest(hints[name], words) for name, words in limits.items()}
    assert len(json.dumps(body)) <= body_bytes(kind)


def lists(hint, words, path=()):
    """Yield the path of every list in an annotation, and how long it may be."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is tuple and Ellipsis in arguments:
        yield path, (words.get("minItems", 0), words["maxItems"])
        yield from lists(arguments[0], words.get(INNER, {}), (*path, 0))
    elif origin is not tuple:
        for part in arguments:
            yield from lists(part, words, path)


BOUNDED = [
    (name, field, *found)
    for name, kind in MESSAGES.items()
    for field, words in limits_of(kind).items()
    for found in lists(get_type_hints(kind)[field], words)
]


@pytest.mark.parametrize(("name", "field", "path", "length"), BOUNDED)
def test_a_list_is_counted_before_its_values_are_looked_at(at, name, field, path, length):
    value = [None] * (length[1] + 1)
    for _ in path:
        value = [value]
    for kind in ("commands", "jobs"):
        answer = at("POST", f"/{kind}/{name}", json={field: value})
        if answer.status_code != 404:
            break
    errors = [one for one in answer.json()["errors"] if one["pointer"].startswith(f"/{field}")]
    pointer = "/" + "/".join(map(str, (field, *path)))
    detail = f"expected {length[0]} to {length[1]} values, not {length[1] + 1}"
    assert errors == [{"pointer": pointer, "detail": detail, "code": "list_length"}]


@pytest.mark.parametrize(("name", "field", "path", "length"), BOUNDED)
def test_the_length_of_a_list_stands_in_the_schema(client, name, field, path, length):
    schema = client.get("/openapi.json").json()["components"]["schemas"][name]
    part = schema["properties"][field]
    for _ in path:
        part = part["items"]
    assert (part.get("minItems", 0), part["maxItems"]) == length


def test_a_list_without_a_length_is_refused_when_the_program_starts():
    @dataclass(frozen=True)
    class Endless:
        points: tuple[float, ...] = ()

    assert len(BOUNDED) >= 18
    with pytest.raises(TypeError, match="state how long it may be"):
        body_bytes(Endless)


@pytest.mark.sweep(12)
@EACH_ROUTE
def test_a_refusal_names_few_places_and_sends_nothing_long_back(
    client, session, method, path, kind
):
    many = {f"k{number}": 1 for number in range(4000)}
    long = {f"{number}{'k' * 5000}": "v" * 500 for number in range(10)}
    for body in (many, long, [1] * 20_000, "x" * 60_000):
        answer = client.request(method, path.format(session), json=body)
        assert answer.status_code == 422, answer.text[:200]
        assert 1 <= len(answer.json()["errors"]) <= MOST_ERRORS
        assert len(answer.content) < SMALL_BYTES
    if kind is not None:
        refused = client.request(method, path.format(session), json=many).json()
        assert "more" in refused["detail"]


def test_addresses_and_names_are_not_sent_back_whole(client, session):
    long = "x" * 30_000
    for method, path in (
        ("GET", f"/sessions/{long}"),
        ("GET", f"/sessions/{session}/results/{long}"),
        ("GET", f"/jobs/{long}"),
        ("GET", f"/sessions/{session}/results/tool?max_points={long}"),
    ):
        answer = client.request(method, path)
        assert 400 <= answer.status_code < 500
        assert len(answer.content) < SMALL_BYTES


@pytest.mark.sweep(12)
@EACH_ROUTE
def test_a_key_that_stands_twice_is_refused_and_named(client, session, method, path, kind):
    before = client.get(f"/sessions/{session}").json()
    for key in (*get_type_hints(kind), "other"):
        if key.startswith("_"):
            continue
        body = f'{{"{key}": 1, "{key}": 2}}'
        answer = client.request(method, path.format(session), content=body, headers=JSON)
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["pointer"] == f"/{key}"
        assert answer.json()["errors"][0]["code"] == "doubled"
        assert "twice" in answer.json()["detail"]
    assert client.get(f"/sessions/{session}").json() == before


@pytest.mark.parametrize(
    ("body", "pointers"),
    [
        ('{"a": [{"b": 1}, {"b": 1, "b": 1}]}', ["/a/1/b"]),
        ('{"a": {"a": 1, "a": 2}, "b": {"c": {"d": 1, "d": 1}}}', ["/a/a", "/b/c/d"]),
        ('{"a": {"b": 1, "b": 1}, "a": 1}', ["/a"]),
        ('{"a\\u0062": 1, "ab": 1}', ["/ab"]),
    ],
)
def test_a_key_that_stands_twice_anywhere_is_named(at, body, pointers):
    answer = at("POST", "/commands/SetSeed", content=body, headers=JSON)
    assert [error["pointer"] for error in answer.json()["errors"]] == pointers


def test_what_is_no_doubled_key_is_read_as_ever():
    body = {"a": [{"b": 1}, {"b": 2}], "b": {"a": {"a": None}}, "c": [1.5, "x", True]}
    assert parsed(json.dumps(body).encode()) == body


def test_every_route_with_a_json_body_is_swept(client):
    swept = {(method, path.format("current")) for method, path, _ in ROUTES}
    assert IN_SESSION in ROUTES[0][1]
    for method, path, operation in operations(client):
        if "application/json" in operation.get("requestBody", {}).get("content", {}):
            assert (method, path.removeprefix(PREFIX)) in swept
