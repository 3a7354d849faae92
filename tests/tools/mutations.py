"""Small changes of a module's syntax tree, each of which a test should notice."""

import ast
from collections.abc import Callable, Iterator

COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
Action = Callable[[], None]


def changes(tree: ast.Module) -> Iterator[tuple[ast.AST, Action]]:
    """Yield every possible change: the node, and what carries it out in place."""
    for parent, name, node in _parts(tree):
        if isinstance(node, ast.Compare):
            for k, op in enumerate(node.ops):
                if type(op) in COMPARED:
                    yield node, _setter(node.ops, k, COMPARED[type(op)]())
        elif isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in COMPUTED:
            yield node, _setter(node, "op", COMPUTED[type(node.op)]())
        elif isinstance(node, ast.BoolOp):
            other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield node, _setter(node, "op", other)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            yield node, _setter(parent, name, node.operand)
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
            value = not node.value if type(node.value) is bool else node.value + 1
            yield node, _setter(node, "value", value)
        if isinstance(node, ast.If | ast.While | ast.IfExp):
            yield node.test, _setter(node, "test", ast.UnaryOp(ast.Not(), node.test))
        if isinstance(node, ast.comprehension):
            for k, test in enumerate(node.ifs):
                yield test, _setter(node.ifs, k, ast.UnaryOp(ast.Not(), test))
        if _may_be_dropped(node):
            yield node, _setter(parent, name, ast.Pass())


def _parts(node: ast.AST) -> Iterator[tuple[object, object, ast.AST]]:
    """Yield (holder, name or index, node) of all that runs: no types, decorators, messages."""
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "type_params"}:
            continue
        items = [(value, k, v) for k, v in enumerate(value)] if isinstance(value, list) else []
        for holder, key, part in items or [(node, name, value)]:
            if not isinstance(part, ast.AST) or isinstance(part, ast.JoinedStr):
                continue
            yield holder, key, part
            if not isinstance(part, ast.Raise) and not _is_declaration(part):
                yield from _parts(part)


def _is_declaration(node: ast.AST) -> bool:
    """Tell names of types and what is exported from values."""
    names = [t.id for t in getattr(node, "targets", []) if isinstance(t, ast.Name)]
    return isinstance(node, ast.Assign) and (
        "__all__" in names or any(n[:1].isupper() and not n.isupper() for n in names)
    )


def _may_be_dropped(node: ast.AST) -> bool:
    """Tell what can be left out without an error of Python's own: calls, raises, stores."""
    if isinstance(node, ast.Expr):
        return not isinstance(node.value, ast.Constant | ast.Yield | ast.YieldFrom)
    if isinstance(node, ast.Assign):
        return not any(isinstance(t, ast.Name | ast.Tuple) for t in node.targets)
    return isinstance(node, ast.AugAssign | ast.Raise | ast.Continue | ast.Break)


def _setter(holder: object, key: object, value: object) -> Action:
    def change() -> None:
        if isinstance(holder, list):
            holder[key] = value  # type: ignore[index]
        else:
            setattr(holder, str(key), value)

    return change
