"""Reader of the YAML that ROS prints: nested keys and lists, lists and keys in brackets, numbers.

What goes beyond (anchors, tags, texts over several lines) is refused by line.
"""

import re
from dataclasses import dataclass
from typing import Any

from rona_core.errors import InvalidInputError

KEY = re.compile(r"([\w./-]+|'[^']*'|\"[^\"]*\")\s*:(?:\s+(.*)|)$")
FLOW = re.compile(r"\s*([\[\]{},:]|'[^']*'|\"[^\"]*\"|[^\[\]{},:\s][^\[\]{},:]*)")
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
SPECIAL = {".nan": float("nan"), ".inf": float("inf"), "-.inf": float("-inf")}
WORDS: dict[str, object] = {"true": True, "false": False, "null": None, "~": None, "": None}
MOST_DEPTH = 40


@dataclass(slots=True)
class _Line:
    number: int
    indent: int
    text: str


def parse_yaml(text: str, name: str) -> Any:
    """Return the first document of a text as dictionaries, lists and plain values.

    Raises:
        InvalidInputError: it is not of this kind of YAML; it says which line.
    """
    lines: list[_Line] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        stripped = re.sub(r"(^|\s)#.*$", "", raw).rstrip()
        if stripped.strip() in ("---", "...", ""):
            if stripped.strip() and lines:
                break
            continue
        if lines and _open(lines[-1].text):
            lines[-1].text += " " + stripped.strip()
            continue
        lines.append(_Line(number, len(stripped) - len(stripped.lstrip()), stripped.strip()))
    return _Parser(lines, name).block(0) if lines else None


def _open(text: str) -> bool:
    """Return whether a line ends within brackets."""
    return sum(text.count(c) for c in "[{") > sum(text.count(c) for c in "]}")


class _Parser:
    def __init__(self, lines: list[_Line], name: str) -> None:
        self._lines, self._name, self._at = lines, name, 0

    def block(self, depth: int) -> Any:
        """Return the value that begins at the line that is next."""
        first = self._lines[self._at]
        if depth > MOST_DEPTH:
            raise self._refusal(first)
        if first.text == "-" or first.text.startswith("- "):
            return self._list(first.indent, depth)
        if KEY.match(first.text):
            return self._keys(first.indent, depth)
        self._at += 1
        return self._value(first.text, first)

    def _list(self, indent: int, depth: int) -> list[Any]:
        found: list[Any] = []
        while (line := self._next(indent)) and (line.text == "-" or line.text.startswith("- ")):
            rest = line.text[1:].lstrip()
            if rest:  # what follows the dash is a line of its own, as far in as it stands
                line.indent += len(line.text) - len(rest)
                line.text = rest
            else:
                self._at += 1
            found.append(self.block(depth + 1))
        return found

    def _keys(self, indent: int, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while (line := self._next(indent)) and (named := KEY.match(line.text)):
            self._at += 1
            key, rest = named[1].strip("'\""), named[2]
            below = self._lines[self._at] if self._at < len(self._lines) else None
            if rest:
                found[key] = self._value(rest, line)
            elif below and (
                below.indent > indent or (below.indent == indent and below.text[:1] == "-")
            ):
                found[key] = self.block(depth + 1)
            else:
                found[key] = None
        return found

    def _next(self, indent: int) -> _Line | None:
        """Return the next line where it stands as far in as this."""
        if self._at >= len(self._lines) or self._lines[self._at].indent < indent:
            return None
        line = self._lines[self._at]
        if line.indent > indent:
            raise self._refusal(line)
        return line

    def _value(self, text: str, line: _Line) -> Any:
        if text[0] not in "[{":
            return self._plain(text, line)
        tokens = FLOW.findall(text)
        value, end = self._flow(tokens, 0, line, 0)
        if end != len(tokens):
            raise self._refusal(line)
        return value

    def _flow(self, tokens: list[str], at: int, line: _Line, depth: int) -> tuple[Any, int]:
        """Return the value that begins at a token, and where the next one is."""
        if at >= len(tokens) or depth > MOST_DEPTH:
            raise self._refusal(line)
        if tokens[at] not in "[{":
            return self._plain(tokens[at].strip(), line), at + 1
        keys, values, closing = [], [], "]" if tokens[at] == "[" else "}"
        at += 1
        while at < len(tokens) and tokens[at] != closing:
            if closing == "}":
                if at + 1 >= len(tokens) or tokens[at + 1] != ":":
                    raise self._refusal(line)
                keys.append(tokens[at].strip().strip("'\""))
                at += 2
            value, at = self._flow(tokens, at, line, depth + 1)
            values.append(value)
            if at < len(tokens) and tokens[at] == ",":
                at += 1
        if at >= len(tokens):
            raise self._refusal(line)
        return (values if closing == "]" else dict(zip(keys, values, strict=True))), at + 1

    def _plain(self, text: str, line: _Line) -> object:
        if text[0] in "'\"":
            return text[1:-1]
        if text.lower() in SPECIAL:
            return SPECIAL[text.lower()]
        if text.lower() in WORDS:
            return WORDS[text.lower()]
        if NUMBER.fullmatch(text):
            return float(text) if re.search(r"[.eE]", text) else int(text)
        if text[0] in "&*!|>@%`":
            raise self._refusal(line)
        return text

    def _refusal(self, line: _Line) -> InvalidInputError:
        return InvalidInputError(
            f"{self._name}, line {line.number}: expected keys, lists and numbers as ROS prints "
            f"them, got {line.text[:40]!r}"
        )
