"""Every refusal as ``application/problem+json`` (RFC 9457): status, code, what to do about it."""

import json
import math
import sys
import traceback
from collections.abc import Sequence
from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from rona_core.errors import (
    InvalidInputError,
    NotFoundError,
    RonaError,
    SessionFormatError,
    StorageError,
    storage_error,
)

MOST_ERRORS = 20  # that one answer names
LONGEST_DETAIL, LONGEST_PLACE = 1000, 200  # characters: what was sent is not sent back
MEDIA_TYPE = "application/problem+json"
STATUS: dict[type[RonaError], int] = {  # all others: 409
    InvalidInputError: 422,
    SessionFormatError: 422,
    NotFoundError: 404,
    StorageError: 507,
}
TITLES = {
    400: ("bad_request", "Bad request"),
    401: ("unauthorized", "Token required"),
    403: ("forbidden", "Forbidden"),
    404: ("not_found", "Not found"),
    405: ("method_not_allowed", "Method not allowed"),
    408: ("timeout", "The request did not come in time"),
    409: ("conflict", "Conflict"),
    413: ("too_large", "Body too large"),
    415: ("unsupported_media_type", "Unsupported media type: send JSON"),
    421: ("misdirected", "Unknown host name"),
    422: ("invalid_input", "Invalid input"),
    500: ("internal", "Internal error"),
    507: ("storage", "Storage error"),
}


class JobFinishedError(RonaError):
    """A job that has ended cannot be cancelled any more."""

    code = "job_finished"


def problem(
    status: int,
    detail: str,
    *,
    code: str | None = None,
    errors: Sequence[dict[str, str]] = (),
    headers: dict[str, str] | None = None,
    backup: object = None,
) -> Response:
    """Return a problem.

    Args:
        status: Of HTTP.
        detail: What was expected, what came, what to do.
        code: Of the error; None: that of the status.
        errors: Places in the body by JSON pointer.
        headers: Further ones.
        backup: Name of the last good copy of a session file that cannot be read.
    """
    usual, title = TITLES.get(status, ("error", "Something went wrong"))
    body: dict[str, Any] = {
        "type": "about:blank",
        "title": title,
        "status": status,
        "code": code or usual,
        "detail": shortened(detail, LONGEST_DETAIL),
    }
    if backup is not None:
        body["backup"] = backup
    if errors:
        body["errors"] = list(errors[:MOST_ERRORS])
    text = json.dumps(body, ensure_ascii=True, allow_nan=False)
    return Response(text, status, headers=headers, media_type=MEDIA_TYPE)


def problem_of(error: RonaError) -> Response:
    """Return the problem that stands for an error of the core."""
    status = next((code for kind, code in STATUS.items() if isinstance(error, kind)), 409)
    return problem(status, str(error), code=error.code, backup=error.data.get("backup"))


def shortened(text: str, most: int) -> str:
    """Return a text of at most so many characters."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def install(app: FastAPI) -> None:
    """Turn everything that goes wrong in ``app`` into problems."""

    @app.exception_handler(RonaError)
    async def _rona(request: Request, error: RonaError) -> Response:
        return problem_of(error)

    @app.exception_handler(RequestValidationError)
    async def _invalid(request: Request, error: RequestValidationError) -> Response:
        found = error.errors()
        errors = [_place(item) for item in found[:MOST_ERRORS]]
        first = f"{errors[0]['pointer']}: {errors[0]['detail']}" if errors else "not valid"
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        if len(found) > MOST_ERRORS:
            more = f" (and more; the first {MOST_ERRORS} are named)"
        return problem(422, first + more, errors=errors)

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> Response:
        headers = dict(error.headers or {})
        if error.status_code == 405 and (methods := await run_in_threadpool(_methods, request)):
            headers["Allow"] = ", ".join(methods)
        return problem(error.status_code, str(error.detail), headers=headers)

    @app.exception_handler(ClientDisconnect)
    async def _gone(request: Request, error: ClientDisconnect) -> Response:
        return problem(400, "the request ended before its body was complete: send it again")

    @app.exception_handler(OSError)
    async def _storage(request: Request, error: OSError) -> Response:
        return problem_of(storage_error(error))

    @app.exception_handler(Exception)
    async def _defect(request: Request, error: Exception) -> Response:
        traceback.print_exception(error, file=sys.stderr)
        text = f"{type(error).__name__}; the server's terminal says more"
        return problem(500, text)


def _methods(request: Request) -> list[str]:
    """Return the methods of all routes at an address; the router names those of one route alone."""
    found: set[str] = set()
    asked = request.url.path.split("/")
    for path, verbs in request.app.openapi()["paths"].items():
        parts = path.split("/")
        if len(parts) == len(asked) and all(
            part == name or part.startswith("{") for part, name in zip(parts, asked, strict=True)
        ):
            found |= {verb.upper() for verb in verbs}
    return sorted(found)


def _place(item: dict[str, Any]) -> dict[str, str]:
    """Return where in the request something is wrong, and what; never the input itself."""
    where, *path = [str(part) for part in item.get("loc", ("body",))]
    whole = [part.encode(errors="replace").decode() for part in path]
    tokens = [part.replace("~", "~0").replace("/", "~1") for part in whole]
    pointer = shortened("".join(f"/{token}" for token in tokens), LONGEST_PLACE)
    if where != "body":
        pointer = f"{where}:{pointer.removeprefix('/')}"
    message = str(item.get("msg", "not valid")).removeprefix("Value error, ")
    given = item.get("input")
    if isinstance(given, float) and not math.isfinite(given):
        message = "expected a finite number"
    message = shortened(message, LONGEST_PLACE)
    return {"pointer": pointer, "detail": message, "code": str(item.get("type", "invalid"))}


RESPONSES: dict[int | str, dict[str, Any]] = {
    status: {
        "description": text,
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
    for status, text in {
        400: "The request could not be read: a body that is no JSON, say",
        401: "No or a wrong token",
        403: "It comes from a page of another origin",
        404: "No such session, job, file or tool",
        405: "The address knows other methods; `Allow` names them",
        408: "Headers or body did not come in time",
        409: "Not possible in the present state; `code` says why",
        413: "The body is larger than this route takes",
        421: "The server does not go by the name in `Host`",
        422: "Invalid input; `errors` points at the places",
        500: "Internal error",
        507: "The file system refused",
    }.items()
}
SCHEMA: dict[str, Any] = {
    "title": "Problem",
    "type": "object",
    "description": "RFC 9457 problem details",
    "required": ["title", "status", "code", "detail"],
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "code": {"type": "string", "description": "stable; the same in browser and terminal"},
        "detail": {"type": "string", "description": "what was expected, what came, what to do"},
        "backup": {
            "type": "string",
            "description": "last good copy of a session file that cannot be read",
        },
        "errors": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "pointer": {"type": "string", "description": "JSON pointer into the body"},
                    "detail": {"type": "string"},
                    "code": {"type": "string"},
                },
            },
        },
    },
}
