"""The frame grammar, checked on the syntax tree: neighbouring words cancel.

``T_base_tip`` is the pose of ``tip`` in ``base``. In ``T_base_flange @ T_flange_tip`` the two inner
words must agree and what is left must match the name it is assigned to. The same holds for ``Ts_``
(a batch), ``R_`` (a rotation), ``.inv()``, points (``T_base_tip @ points_tip``) and directions
(``T_base_tip.rotate(normals_tip)``). Whatever carries no frame in its name is not judged.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FRAMES = frozenset(
    "upright base flange tip burr probe toolmarker tracker basemarker headmarker marker "
    "pointermarker pointertip skull sonomarker mesh patch voxel sensor scene map bed link camera "
    "a b c d".split()
)  # explained in docs/conventions.md; single letters stand for any frame in generic code
TRANSFORM = re.compile(r"_*(?P<kind>Ts?|Rs?)_(?P<words>[a-z0-9_]+)")
QUALIFIERS = frozenset("true nominal measured found best new old n is has".split())
TYPE_VARIABLES = {"T_co", "T_contra"}
KEEPS_FRAMES = {"select", "mean", "copy", "matrix", "normalized", "reshape", "astype"}


@dataclass(frozen=True)
class Transform:
    """A pose of frame ``right`` in frame ``left``."""

    left: str
    right: str

    def __str__(self) -> str:
        return f"{self.left}_{self.right}"


@dataclass(frozen=True)
class Vectors:
    """Points or directions given in ``frame``."""

    frame: str

    def __str__(self) -> str:
        return f"..._{self.frame}"


Meaning = Transform | Vectors | None


def same_frame(a: str, b: str) -> bool:
    """Return whether two words can mean one frame: ``marker`` stands for any tool's marker."""
    if a == b or len(a) == 1 or len(b) == 1:
        return True
    return "marker" in (a, b) and a.endswith("marker") and b.endswith("marker")


def meaning_of_name(name: str) -> Meaning:
    """Return what a name says by the grammar, None where it says nothing about frames."""
    match = TRANSFORM.fullmatch(name)
    if match:
        words = match["words"].split("_")
        if len(words) >= 2 and words[0] in FRAMES and words[1] in FRAMES:
            return Transform(words[0], words[1])
        return None
    words = name.split("_")
    a_thing = words[0] in QUALIFIERS or name.isupper()  # "true_tip" is a tip, not given in tip
    if len(words) >= 2 and words[-1] in FRAMES and not a_thing:
        return Vectors(words[-1])
    return None


def grammar_error(name: str) -> str | None:
    """Return what is wrong with the frame words of ``name``, None if nothing is."""
    match = TRANSFORM.fullmatch(name)
    if not match or name in TYPE_VARIABLES or match["kind"].startswith("R"):
        return None
    words = match["words"].split("_")
    if len(words) < 2:
        return f"{name} names one frame, a pose needs two: T_<frame>_<frame>"
    unknown = [word for word in words[:2] if word not in FRAMES]
    if unknown:
        return f"{name} uses the word {unknown[0]!r}, which is no frame of docs/conventions.md"
    extra = [word for word in words[2:] if word in FRAMES]
    if extra:
        return f"{name} names more than two frames"
    return None


class FrameChecker(ast.NodeVisitor):
    """Collects (line, message) for everything in one module that breaks the grammar."""

    def __init__(self) -> None:
        self.errors: list[tuple[int, str]] = []
        self._functions: list[str] = []

    # -- what an expression means ---------------------------------------------------------------

    def infer(self, node: ast.expr | None) -> Meaning:
        """Return the frames of an expression as far as its names tell."""
        match node:
            case ast.Name(id=name):
                return meaning_of_name(name)
            case ast.Attribute():
                return self._attribute(node)
            case ast.Call():
                return self._call(node)
            case ast.Subscript(value=value, slice=index):
                inner = self.infer(value)
                if isinstance(inner, Transform) and isinstance(index, ast.Tuple):
                    # rotation[:, 2] is a direction in the left frame; other blocks say nothing
                    column = isinstance(index.elts[-1], ast.Constant)
                    return Vectors(inner.left) if column else None
                return inner
            case ast.UnaryOp(operand=operand):
                inner = self.infer(operand)
                return inner if isinstance(inner, Vectors) else None
            case ast.IfExp(body=body, orelse=orelse):
                first, second = self.infer(body), self.infer(orelse)
                return first if second is None or first == second else second
            case ast.BinOp(op=ast.MatMult()):
                return self._product(node)
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                first, second = self.infer(left), self.infer(right)
                return first if isinstance(first, Vectors) and first == second else None
            case _:
                return None

    def _attribute(self, node: ast.Attribute) -> Meaning:
        inner = self.infer(node.value)
        if isinstance(inner, Transform):
            if node.attr in ("translation", "translations"):
                return Vectors(inner.left)
            if node.attr in ("rotation", "rotations"):
                return inner
            if node.attr == "T":
                return Transform(inner.right, inner.left)
        if node.attr == "T":
            return inner
        return meaning_of_name(node.attr)

    def _call(self, node: ast.Call) -> Meaning:
        function = node.func
        if isinstance(function, ast.Attribute):
            inner = self.infer(function.value)
            if isinstance(inner, Transform) and function.attr == "inv":
                return Transform(inner.right, inner.left)
            if isinstance(inner, Transform) and function.attr == "rotate" and node.args:
                return self._apply(inner, self.infer(node.args[0]), node)
            if inner is not None and function.attr in KEEPS_FRAMES:
                return inner
            if function.attr == "inv" and node.args:  # np.linalg.inv
                inner = self.infer(node.args[0])
                return Transform(inner.right, inner.left) if isinstance(inner, Transform) else None
            meaning = meaning_of_name(function.attr)
        elif isinstance(function, ast.Name):
            if function.id in ("readonly", "as_points", "as_vector3", "as_unit_vectors"):
                return self.infer(node.args[0]) if node.args else None
            meaning = meaning_of_name(function.id)
        else:
            return None
        return meaning if isinstance(meaning, Transform) else None

    def _product(self, node: ast.BinOp) -> Meaning:
        left, right = self.infer(node.left), self.infer(node.right)
        return self._apply(left, right, node) if isinstance(left, Transform) else None

    def _apply(self, left: Transform, right: Meaning, node: ast.expr) -> Meaning:
        if right is None:
            return None
        inner = right.left if isinstance(right, Transform) else right.frame
        if not same_frame(left.right, inner):
            self._report(
                node, f"{ast.unparse(node)}: {left.right!r} and {inner!r} are side by side"
            )
            return None
        return (
            Transform(left.left, right.right)
            if isinstance(right, Transform)
            else Vectors(left.left)
        )

    # -- where a meaning is given a name --------------------------------------------------------

    def _report(self, node: ast.AST, message: str) -> None:
        entry = (getattr(node, "lineno", 0), message)
        if entry not in self.errors:
            self.errors.append(entry)

    def _bind(self, target: ast.expr, value: Meaning, node: ast.AST) -> None:
        if isinstance(target, ast.Attribute):
            self._match(meaning_of_name(target.attr), value, ast.unparse(target), node)
        elif isinstance(target, ast.Name):
            self._match(meaning_of_name(target.id), value, target.id, node)

    def _match(self, declared: Meaning, value: Meaning, name: str, node: ast.AST) -> None:
        match declared, value:
            case Transform(), Transform():
                fits = same_frame(declared.left, value.left) and same_frame(
                    declared.right, value.right
                )
            case Vectors(), Vectors():
                fits = same_frame(declared.frame, value.frame)
            case Transform(), Vectors():
                fits = False
            case _:
                return  # nothing is known about one of the two
        if not fits:
            self._report(node, f"{name} is given a value of {value}")

    def _bind_value(self, target: ast.expr, value: ast.expr, node: ast.AST) -> None:
        if isinstance(target, ast.Tuple | ast.List) and isinstance(value, ast.Tuple | ast.List):
            for part, part_value in zip(target.elts, value.elts, strict=False):
                self._bind_value(part, part_value, node)
        else:
            self._bind(target, self.infer(value), node)

    def visit_Assign(self, node: ast.Assign) -> None:
        for target in node.targets:
            self._bind_value(target, node.value, node)
        self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._bind_value(node.target, node.value, node)
        self.generic_visit(node)

    def visit_NamedExpr(self, node: ast.NamedExpr) -> None:
        self._bind_value(node.target, node.value, node)
        self.generic_visit(node)

    def visit_For(self, node: ast.For) -> None:
        self._bind(node.target, self.infer(node.iter), node)
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        self._bind(node.target, self.infer(node.iter), node.iter)
        self.generic_visit(node)

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is not None and self._functions:
            name = self._functions[-1]
            declared = meaning_of_name(name)
            if isinstance(declared, Transform):
                self._match(declared, self.infer(node.value), f"{name}()", node)
        self.generic_visit(node)

    # -- every name ------------------------------------------------------------------------------

    def _name(self, name: str, node: ast.AST) -> None:
        error = grammar_error(name)
        if error:
            self._report(node, error)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        self._name(node.name, node)
        self._functions.append(node.name)
        self.generic_visit(node)
        self._functions.pop()

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self.visit_FunctionDef(node)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self._functions.append("<lambda>")
        self.generic_visit(node)
        self._functions.pop()

    def visit_arg(self, node: ast.arg) -> None:
        self._name(node.arg, node)
        self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Store):
            self._name(node.id, node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if isinstance(node.ctx, ast.Store):
            self._name(node.attr, node)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        self.infer(node)
        for keyword in node.keywords:
            if keyword.arg is not None:
                self._match(
                    meaning_of_name(keyword.arg), self.infer(keyword.value), keyword.arg, node
                )
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        self.infer(node)
        self.generic_visit(node)


def check_source(source: str, where: str) -> list[str]:
    """Return every violation in one module as ``where:line: message``."""
    checker = FrameChecker()
    checker.visit(ast.parse(source))
    return [f"{where}:{line}: {message}" for line, message in sorted(checker.errors)]


def check_folder(folder: Path, root: Path) -> Iterator[str]:
    """Yield every violation in the Python files below ``folder``."""
    for path in sorted(folder.rglob("*.py")):
        yield from check_source(path.read_text("utf-8"), str(path.relative_to(root)))
