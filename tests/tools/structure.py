"""Figures of the structure: statements, lines, imports, circles, functions, walks of derivations.

``python -m tests.tools.structure`` prints them all, of this checkout or of the one given; the
walks are those of the checkout that Python imports.
"""

import ast
import importlib
import inspect
import io
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = ("rona_core", "rona_ui")
Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def tree(path: Path) -> ast.Module:
    """Return the syntax tree of a module."""
    return ast.parse(path.read_text("utf-8"))


def modules(root: Path, *folders: str) -> list[Path]:
    """Return all modules of the folders, sorted."""
    return sorted(p for folder in folders for p in (root / folder).rglob("*.py"))


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
    edges = imports(root, *folders)
    packages = {
        ".".join(name.split(".")[:depth]) for name in edges for depth in range(1, name.count("."))
    } | {name.rpartition(".")[0] for name in edges}
    found = []
    for package in sorted(packages):
        graph: dict[str, set[str]] = defaultdict(set)
        for name, targets in edges.items():
            for target in targets:
                pair = [_child(package, one) for one in (name, target)]
                if None not in pair and pair[0] != pair[1]:
                    graph[str(pair[0])].add(str(pair[1]))
        found += [f"{package}: {' <-> '.join(sorted(group))}" for group in _groups(graph)]
    return found


def _child(package: str, module: str) -> str | None:
    if not module.startswith(f"{package}."):
        return None
    return module[len(package) + 1 :].split(".")[0]


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


def statements(path: Path) -> int:
    """Return the statements of a module; docstrings are none."""
    return sum(
        isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for node in ast.walk(tree(path))
    )


def import_lines(path: Path) -> int:
    """Return the lines of a module that its import statements take."""
    return sum(
        (node.end_lineno or node.lineno) - node.lineno + 1
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Import | ast.ImportFrom)
    )


def lines(path: Path) -> int:
    """Return all lines of a module."""
    return len(path.read_text("utf-8").splitlines())


class Walk:
    """The files through which the first parameter of a function is passed on, depth first.

    Calls are followed that get it as an argument by its bare name, each function once; so are
    classes, into what makes them.

    Attributes:
        entered: Files, in the order in which a reader enters them.
        returns: How often a reader comes back to one of them.
    """

    def __init__(self, root: Path, module: str, function: str) -> None:
        """Walk from a function of a module, both by name."""
        self._root = root
        self._seen: set[tuple[str, str]] = set()
        self.entered = [module]
        self.returns = 0
        self._follow(module, function, 0)

    def _tree(self, module: str) -> ast.Module | None:
        path = self._root.joinpath(*module.split(".")).with_suffix(".py")
        return tree(path) if path.is_file() else None

    def _follow(self, module: str, function: str, place: int | str) -> None:
        node = self._definition(module, function)
        names = [] if node is None else [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
        names = names[names[:1] == ["self"] :]
        passed = names[place] if isinstance(place, int) and place < len(names) else place
        if node is None or not isinstance(passed, str) or (module, function) in self._seen:
            return
        self._seen.add((module, function))
        for call in (n for n in ast.walk(node) if isinstance(n, ast.Call)):
            places: list[int | str | None] = [
                i for i, a in enumerate(call.args) if isinstance(a, ast.Name) and a.id == passed
            ]
            places += [
                k.arg
                for k in call.keywords
                if isinstance(k.value, ast.Name) and k.value.id == passed
            ]
            if places and places[0] is not None and isinstance(call.func, ast.Name):
                self._visit(module, *self._origin(module, call.func.id), places[0])

    def _visit(self, caller: str, module: str, function: str, place: int | str) -> None:
        if self._definition(module, function) is None:
            return
        if module != caller and module not in self.entered:
            self.entered.append(module)
        elif module != caller:
            self.returns += 1
        self._follow(module, function, place)
        self.returns += module != caller

    def _definition(self, module: str, name: str) -> ast.FunctionDef | None:
        tree = self._tree(module)
        for node in [] if tree is None else tree.body:
            if isinstance(node, ast.FunctionDef) and node.name == name:
                return node
            if isinstance(node, ast.ClassDef) and node.name == name:
                inside = (n for n in node.body if isinstance(n, ast.FunctionDef))
                return next((n for n in inside if n.name == "__init__"), None)
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
                wrapped = [a.id for a in ast.walk(node.value) if isinstance(a, ast.Name)]
                return next((f for w in wrapped if (f := self._definition(module, w))), None)
        return None

    def _origin(self, module: str, name: str) -> tuple[str, str]:
        tree = self._tree(module)
        for node in ast.walk(tree) if tree is not None else ():
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    if (alias.asname or alias.name) == name:
                        return node.module, alias.name
        return module, name


def walks(root: Path) -> dict[str, Walk]:
    """Return the walk from the derivation of each result, longest first."""
    importlib.import_module("rona_core.compose")  # declares the steps
    from rona_core.app.declarations.registry import REGISTRY

    found: dict[str, Walk] = {}
    for step in REGISTRY.steps:
        for result in step.results:
            if result.derive is not None:
                derive = inspect.unwrap(result.derive)
                name = f"{result.name} ({derive.__module__}.{derive.__name__})"
                found[name] = Walk(root, derive.__module__, derive.__name__)
    return dict(sorted(found.items(), key=lambda item: -len(item[1].entered)))


def main(root: Path) -> None:
    """Print all figures."""
    paths = modules(root, *PRODUCT)
    counts = {path: lines(path) for path in paths}
    imported = {path: import_lines(path) for path in paths}
    total = sum(counts.values())
    short = [path for path in paths if path.name != "__init__.py" and counts[path] < 60]
    worst = max(
        paths, key=lambda path: (counts[path] >= 60) * imported[path] / max(counts[path], 1)
    )
    print("statements, docstrings aside:", sum(map(statements, paths)))
    print("lines:", total, "| neither blank nor comment:", sum(map(code_lines, paths)))
    print(
        f"import lines: {100.0 * sum(imported.values()) / total:.1f} % | most in",
        f"{worst.relative_to(root)}: {100.0 * imported[worst] / counts[worst]:.0f} %",
    )
    print("modules:", len(paths), "| under 60 lines:", len(short))
    print("longest:", *(f"{p.relative_to(root)} {counts[p]}" for p in _largest(paths, counts)))
    for title, found in (
        ("circles", circles(root, *PRODUCT)),
        ("functions of more than 7 parameters", wide_functions(root, *PRODUCT)),
        ("functions of more than 60 lines", long_functions(root, *PRODUCT)),
    ):
        print(f"{title}: {len(found)}", *found, sep="\n    ")
    print("walks from derivations, files entered / returns:")
    for name, walk in walks(root).items():
        print(f"    {len(walk.entered):3} / {walk.returns:3}  {name}")


def _largest(paths: list[Path], counts: dict[Path, int]) -> list[Path]:
    return sorted(paths, key=lambda path: -counts[path])[:3]


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
