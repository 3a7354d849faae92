"""Write ``docs/settings.md`` from the declarations of the fields of all messages.

``python -m docs.guide.settings_page`` (``make settings``); a test compares page and declarations.
"""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.devices.limits import limits_of, meaning

PAGE = Path(__file__).resolve().parents[1] / "settings.md"
INTRO = """# Settings

Fields of the messages that the page, the REST interface and scripts send, with their ranges; both
ends are allowed. A share is shown in per cent by the page. Written by `make settings` from the
declarations in the code (`rona_core/devices/limits.py`), which checks, forms and the REST schema
read as well.
"""
HEAD = "| Setting | Field | Default | Range | Meaning |\n|---|---|---|---|---|\n"


def page() -> str:
    """Return the page: by step, a table for each message with declared fields."""
    parts = [INTRO]
    for step in REGISTRY.steps:
        kinds = [part.message for part in (*step.commands, *step.activities)]
        tables = [table for kind in kinds if (table := _table(kind))]
        if tables:
            parts += [f"## {step.name.capitalize()}\n", *tables]
    return "\n".join(parts)


def _table(kind: Any) -> str:
    """Return the table of a message; empty where no field of it is declared."""
    defaults = {part.name: part.default for part in fields(kind)}
    rows = [
        _row(name, words, defaults[name])
        for name, words in limits_of(kind).items()
        if "label" in words
    ]
    summary = (kind.__doc__ or "").splitlines()[0]
    return f"### `{kind.__name__}`\n\n{summary}\n\n{HEAD}{''.join(rows)}" if rows else ""


def _row(name: str, words: Mapping[str, Any], default: Any) -> str:
    unit = f" {words['unit']}" if words.get("unit") else ""
    span = f"{words['minimum']:.12g} to {words['maximum']:.12g}{unit}" if "minimum" in words else ""
    if "labels" in words:
        span = ", ".join(f"`{value}`" for value in words["labels"])
    held = "required" if default is MISSING else f"`{_plain(default)}`"
    return f"| {words['label']} | `{name}` | {held} | {span} | {meaning(words)} |\n"


def _plain(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_plain(part) for part in value)}]"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return value if isinstance(value, str) else f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
