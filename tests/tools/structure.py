"""Figures of the structure: folders, circles, long and wide functions, lines; see CONTRIBUTING.md.

``python -m tests.tools.structure`` prints them all, of this checkout or of the one given.
"""

import ast
import io
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = ("rona_core", "rona_ui")
NO_ENTRIES = {"__init__.py", "__pycache__", "py.typed"}
Function = ast.FunctionDef | ast.AsyncFunctionDef


def modules(root: Path, *folders: str) -> list[Path]:
    """Return all modules of the folders, sorted."""
    return sorted(p for folder in folders for p in (root / folder).rglob("*.py"))


@cache
def tree(path: Path) -> ast.Module:
    """Return the syntax tree of a module; it is parsed once."""
    return ast.parse(path.read_text("utf-8"))


def entries(root: Path, *folders: str) -> dict[str, int]:
    """Return how many files and folders each folder with modules holds, fullest first."""
    counts = {}
    for path in {p.parent for folder in folders for p in (root / folder).rglob("*.py")}:
        inside = [p for p in path.iterdir() if p.name not in NO_ENTRIES]
        counts[str(path.relative_to(root))] = len(inside)
    return dict(sorted(counts.items(), key=lambda item: -item[1]))


def functions(root: Path, *folders: str) -> Iterator[tuple[str, Function]]:
    """Yield every function with its place."""
    for path in modules(root, *folders):
        for node in ast.walk(tree(path)):
            if isinstance(node, Function):
                yield f"{path.relative_to(root)}:{node.lineno} {node.name}", node


def parameters(node: Function) -> int:
    """Return how many parameters a function has, self and cls not counted."""
    names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    extra = (node.args.vararg is not None) + (node.args.kwarg is not None)
    return len(names) + extra - (names[:1] in (["self"], ["cls"]))


def wide_functions(root: Path, *folders: str, most: int = 7) -> list[str]:
    """Return the functions with more parameters than ``most``."""
    return [
        f"{place}: {parameters(node)}"
        for place, node in functions(root, *folders)
        if parameters(node) > most
    ]


def long_functions(root: Path, *folders: str, most: int = 60) -> list[str]:
    """Return the functions with more lines than ``most``, docstring and signature counted."""
    found = []
    for place, node in functions(root, *folders):
        lines = (node.end_lineno or node.lineno) - node.lineno + 1
        if lines > most:
            found.append(f"{place}: {lines}")
    return found


def code_lines(path: Path) -> int:
    """Return the lines of a module that are neither blank nor a comment; docstrings count."""
    lines: set[int] = set()
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    source = io.BytesIO(path.read_bytes())
    for token in tokenize.tokenize(source.readline):
        if token.type not in skipped | {tokenize.ENCODING, tokenize.ENDMARKER}:
            lines |= {
                n
                for n, text in enumerate(token.string.splitlines() or [""], token.start[0])
                if text.strip()
            }
    return len(lines)


def imports(root: Path, *folders: str) -> dict[str, set[str]]:
    """Return the modules of the product that each module imports, wherever in it."""
    names = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        for path in modules(root, *folders)
    }
    edges: dict[str, set[str]] = {}
    for path in modules(root, *folders):
        module = ".".join(path.relative_to(root).with_suffix("").parts)
        if module.endswith(".__init__"):
            continue  # a front door imports what is behind it
        edges[module] = set()
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and node.module in names:
                edges[module] |= {
                    full if (full := f"{node.module}.{alias.name}") in names else node.module
                    for alias in node.names
                }
            elif isinstance(node, ast.Import):
                edges[module] |= {alias.name for alias in node.names if alias.name in names}
    return edges


def circles(root: Path, *folders: str) -> list[str]:
    """Return the rooms and modules of each package that import one another in a circle."""
    graphs: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for name, targets in imports(root, *folders).items():
        for target in targets:
            here, there = name.split("."), target.split(".")
            depth = next(
                (k for k, pair in enumerate(zip(here, there, strict=False)) if len({*pair}) > 1), 0
            )
            if depth:
                graphs[".".join(here[:depth])][here[depth]].add(there[depth])
    return [
        f"{package}: {' <-> '.join(sorted(group))}"
        for package, graph in sorted(graphs.items())
        for group in _groups(graph)
    ]


def _reached(graph: dict[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    todo = [start]
    while todo:
        for target in graph.get(todo.pop(), set()) - seen:
            seen.add(target)
            todo.append(target)
    return seen


def _groups(graph: dict[str, set[str]]) -> list[set[str]]:
    """Return the sets of nodes that reach one another."""
    reached = {node: _reached(graph, node) for node in graph}
    groups = []
    for node in graph:
        group = {other for other in reached[node] if node in reached.get(other, set())}
        if group and group not in groups:
            groups.append(group)
    return groups


def word_count(root: Path, folder: str, word: str) -> int:
    """Return how often a name is used in a folder."""
    return sum(
        isinstance(node, ast.Name) and node.id == word
        for path in modules(root, folder)
        for node in ast.walk(tree(path))
    )


def main(root: Path) -> None:
    """Print all figures."""
    own = [name for name in (*PRODUCT, "tests", "benchmarks", "examples") if (root / name).is_dir()]
    full = entries(root, *own)
    print("fullest folders:", ", ".join(f"{name} {n}" for name, n in list(full.items())[:5]))
    for title, found in (
        ("circles", circles(root, *PRODUCT)),
        ("functions of more than 7 parameters", wide_functions(root, *PRODUCT)),
        ("functions of more than 60 lines", long_functions(root, *PRODUCT)),
    ):
        print(f"{title}: {len(found)}", *found, sep="\n    ")
    paths = modules(root, *PRODUCT)
    print("modules:", len(paths))
    print("product lines, neither blank nor comment:", sum(map(code_lines, paths)))
    print("`Any` in rona_core/app:", word_count(root, "rona_core/app", "Any"))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
