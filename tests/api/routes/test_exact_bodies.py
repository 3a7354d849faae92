"""Bodies over REST: whatever is of another type than its field is refused, and the field named."""

import dataclasses
import json
from types import NoneType, UnionType
from typing import Literal, Union, get_args, get_origin, get_type_hints

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.setup.messages import SetContact, SetProbe, SetRobot, SetTracker
from rona_ui.api.routes.calibrations import HandEyeFiles
from rona_ui.api.routes.devices import PointerTurn, ToolPose, Visible
from rona_ui.api.routes.sessions import FileToOpen, FileToSave, NewSession

IN_SESSION = "/sessions/{}"
ROUTES = [
    *(
        ("POST", f"{IN_SESSION}/commands/{name}", kind)
        for name, kind in REGISTRY.command_types.items()
    ),
    *(
        ("POST", f"{IN_SESSION}/jobs/{name}", kind)
        for name, kind in REGISTRY.activity_types.items()
    ),
    ("POST", "/sessions", NewSession),
    ("POST", "/sessions/open", FileToOpen),
    ("POST", f"{IN_SESSION}/save", FileToSave),
    ("POST", f"{IN_SESSION}/calibrations/hand-eye", HandEyeFiles),
    ("POST", f"{IN_SESSION}/calibrations/hand-eye/picture", HandEyeFiles),
    ("POST", f"{IN_SESSION}/robot/move", REGISTRY.activity_types["StartRobotMove"]),
    ("PUT", f"{IN_SESSION}/robot/settings", SetRobot),
    ("PUT", f"{IN_SESSION}/robot/contact", SetContact),
    ("PUT", f"{IN_SESSION}/probe/settings", SetProbe),
    ("PUT", f"{IN_SESSION}/tracker/settings", SetTracker),
    ("PUT", f"{IN_SESSION}/tracker/tools/pointer6d/visible", Visible),
    ("PUT", f"{IN_SESSION}/tracker/tools/pointer6d/pose", ToolPose),
    ("PUT", f"{IN_SESSION}/operator/pointer", PointerTurn),
]
WRONG = {int: ["1", True, 1.0], float: ["60", True], bool: ["yes", 1], str: [1, "a\0b", "a\u202eb"]}


def wrong_values(hint):
    """Return pairs of a value that is of another type and the pointer below the field."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return wrong_values(next(option for option in arguments if option is not NoneType))
    if origin is Literal:
        return [(1, ""), ("no such choice", "")]
    if origin is tuple:
        count = 1 if arguments[-1] is Ellipsis else len(arguments)
        inside = wrong_values(arguments[0])
        return [("1", ""), *(([value] * count, f"/0{below}") for value, below in inside)]
    return [(value, "") for value in WRONG[hint]]


@pytest.mark.sweep(12)
@pytest.mark.parametrize(
    ("method", "path", "kind"), ROUTES, ids=lambda v: getattr(v, "__name__", v)
)
def test_a_lax_body_is_refused_and_its_field_named(client, session, method, path, kind):
    before = client.get(f"/sessions/{session}").json()
    for field in dataclasses.fields(kind):
        hint = get_type_hints(kind)[field.name]
        for value, below in wrong_values(hint):
            answer = client.request(method, path.format(session), json={field.name: value})
            assert answer.status_code == 422, (field.name, value)
            pointers = [error["pointer"] for error in answer.json()["errors"]]
            assert f"/{field.name}{below}" in pointers, (value, answer.text)
    assert client.get(f"/sessions/{session}").json() == before


def test_every_route_with_a_body_is_in_the_table(client):
    document = client.get("/openapi.json").json()
    taken = {(method, path.format("{session_id}")) for method, path, _ in ROUTES}
    for path, verbs in document["paths"].items():
        for verb, operation in verbs.items():
            body = operation.get("requestBody", {}).get("content", {})
            if "application/json" in body:
                short = path.removeprefix("/api/v1").replace("{name}", "pointer6d")
                assert (verb.upper(), short) in taken, f"{verb} {path} may take what is lax"


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("commands/SetTracker", {"rate_hz": 30}),  # JSON has one kind of number
        ("commands/SetRobot", {"base_shift_mm": [1, 2.5, 3]}),
        ("commands/ExcludePoses", {"step": "tool", "indices": []}),
        ("commands/SetRegion", {"center_mesh_mm": None, "radius_mm": 20}),
    ],
)
def test_what_json_cannot_say_otherwise_is_taken(at, path, body):
    answer = at("POST", f"/{path}", json=body)
    assert answer.status_code == 200 or answer.json()["code"] == "step_blocked", answer.text


def test_an_upload_without_a_body_is_refused(at, web, session):
    for sent in ({}, {"content": b""}):
        answer = at("POST", "/uploads", params={"name": "empty.nrrd"}, **sent)
        assert answer.status_code == 422
        assert answer.json()["errors"] == [
            {"pointer": "", "detail": "expected the file as the body", "code": "missing"}
        ]
    assert not (web.hub.files.uploads / "empty.nrrd").exists()


def test_half_a_character_in_the_name_of_a_field_is_refused(at):
    for body in ({"name": "a", "\ud800": 1}, {"name": "\udfff"}):
        sent = json.dumps(body)
        headers = {"Content-Type": "application/json"}
        answer = at("POST", "/commands/RenameSession", content=sent, headers=headers)
        assert answer.status_code == 422
        json.dumps(answer.json(), ensure_ascii=False).encode()  # whole characters in the answer
