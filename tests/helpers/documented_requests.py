"""Requests that the documents speak of: in code spans and in lines of curl."""

import re
import shlex
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"]
VERB = r"(?:GET|POST|PUT|DELETE|PATCH)"
SPAN = re.compile(r"`([^`\n]+)`(?:[^`\n]{0,24}\n?[^`\n]{0,12}\bwith `(\{[^`]+\})`)?")
REQUEST = re.compile(rf"(?:({VERB}(?:\|{VERB})*) )?((?:…|/api/v1)?/(?!api/v1$)\S.*|results/\w+)")
FENCE = re.compile(r"^```\w*\n(.*?)^```", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Request:
    """A request as a page has it; ``path`` begins with ``…/`` where it is one of a session."""

    page: str
    method: str
    path: str
    body: str | None = None


def documented():
    """Return every request of all pages, each once."""
    found = [one for page in PAGES for one in (*_curl(page), *_spans(page))]
    return list({(one.method, one.path, one.body): one for one in found}.values())


def _spans(page):
    text = FENCE.sub("", page.read_text("utf-8"))
    for part in re.split(r"\n\n|\n(?=\|)|\n(?=\* )", text):  # paragraph, row of a table, item
        verbs = "GET"
        for span, body in SPAN.findall(part):
            match = REQUEST.fullmatch(span)
            if match is None or (not match[1] and match[2][0] == "/" and match[2][:4] != "/api"):
                continue
            path = match[2]
            if path.startswith("results/"):
                verbs, path = "GET", f"…/{path}"
            verbs = match[1] or verbs
            for verb in verbs.split("|"):
                yield Request(page.name, verb, path, body or None)


def _curl(page):
    for block in FENCE.findall(page.read_text("utf-8")):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("curl "):
                yield _of_curl(page, shlex.split(line, comments=True))


def _of_curl(page, words):
    options = dict(pairwise(words))
    body, data = options.get("-d"), options.get("--data-binary")
    (path,) = (word for word in words if word.startswith("$api"))
    method = options.get("-X", "POST" if body or data else "GET")
    return Request(
        page.name, method, re.sub(r"^\$api(/sessions/current)?", _begin, path), body or data
    )


def _begin(match):
    return "…" if match[1] else ""
