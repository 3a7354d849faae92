"""Write the reference of the public packages of ``rona_core`` from their docstrings.

``python -m docs.guide.api_reference FOLDER`` (``make api``) makes a page for each package.
"""

import importlib
import inspect
import pkgutil
import sys
from pathlib import Path
from typing import Any

import rona_core


def public_packages() -> list[str]:
    """Return the packages that say what they export."""
    names = [m.name for m in pkgutil.walk_packages(rona_core.__path__, "rona_core.") if m.ispkg]
    return ["rona_core", *(n for n in names if hasattr(importlib.import_module(n), "__all__"))]


def entry(name: str, thing: Any) -> str:
    """Return the text about a class, a function or a value."""
    kind = "class" if inspect.isclass(thing) else "def" if callable(thing) else ""
    if not kind:
        return f"## {name}\n\n`{thing!r}`\n"
    try:
        signature = str(inspect.signature(thing)).replace(" -> None", "")
    except ValueError:
        signature = ""
    doc = inspect.getdoc(thing) or ""
    module = getattr(thing, "__module__", "")
    return f"## {name}\n\n    {kind} {name}{signature}\n\nIn `{module}`.\n\n{doc}\n"


def page(package: str) -> str:
    """Return the page of a package."""
    module = importlib.import_module(package)
    entries = [entry(name, getattr(module, name)) for name in sorted(module.__all__)]
    return f"# {package}\n\n{inspect.getdoc(module)}\n\n" + "\n".join(entries)


def write(folder: Path) -> list[Path]:
    """Write all pages and a list of them."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for package in public_packages():
        file = folder / f"{package}.md"
        file.write_text(page(package), "utf-8")
        files.append(file)
    lines = [f"* [{file.stem}]({file.name})" for file in files]
    (folder / "index.md").write_text("# API reference\n\n" + "\n".join(lines) + "\n", "utf-8")
    return files


if __name__ == "__main__":
    write(Path(sys.argv[1]))
