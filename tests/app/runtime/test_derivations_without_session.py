"""Derivations get values: none of them, and no module that holds one, knows the session."""

import ast
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from rona_core.app.declarations.inputs import input_parts
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.acoustics.derivation import LineInputs
from rona_core.app.steps.implant.view import milling_view
from rona_core.session.document import Session
from tests.tools import structure

RESULTS = [result for step in REGISTRY.steps for result in step.results]
DERIVATIONS = {
    f"{result.name} by {result.message.__name__}": function
    for result in RESULTS
    for function in (result.derive, result.recompute)
    if function is not None
}


def takes_session(function: Callable[..., object]) -> list[str]:
    """Return the parameters of a function that are annotated as a session, or with one."""
    hints = get_type_hints(function)
    return [
        name
        for name, hint in hints.items()
        if name != "return" and (hint is Session or Session in get_args(hint))
    ]


def imports_session(module: Path) -> bool:
    """Return whether a module imports the session, or the module that holds it."""
    nodes = list(ast.walk(structure.tree(module)))
    home = Session.__module__
    named = [n for n in nodes if isinstance(n, ast.ImportFrom) and n.module == home]
    whole = [a.name for n in nodes if isinstance(n, ast.Import) for a in n.names]
    beside = [
        f"{n.module}.{a.name}" for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names
    ]
    return any(a.name == "Session" for n in named for a in n.names) or home in (*whole, *beside)


def knows_session(function: Callable[..., object]) -> list[str]:
    """Return where a derivation, or the module that holds it, knows the session."""
    module = Path(inspect.getfile(function))
    found = [f"{module.name}: {name} of {function.__name__}" for name in takes_session(function)]
    return [*found, f"{module.name} imports it"] if imports_session(module) else found


@pytest.mark.parametrize("name", DERIVATIONS)
def test_no_derivation_knows_the_session(name):
    assert knows_session(DERIVATIONS[name]) == []


def test_every_replayed_result_takes_a_class_of_inputs():
    for result in RESULTS:
        assert (result.derive is None) == (result.known is None)
        if result.known is not None:
            assert result.inputs == input_parts(result.known).counted


def test_a_derivation_that_knows_the_session_is_found(tmp_path):
    """The planted faults: a view in place of a derivation, and each way to import the session."""
    assert knows_session(milling_view) == ["view.py: session of milling_view", "view.py imports it"]

    def derive(known: LineInputs, message: object, held: Session | None = None) -> float:
        return 1.0

    assert takes_session(derive) == ["held"]
    lines = (
        "from rona_core.session.document import Derived, Session",
        "import rona_core.session.document",
        "from rona_core.session import document",
        "def f():\n    from rona_core.session.document import Session",
        "from rona_core.session.document import Derived",
    )
    found = []
    for number, line in enumerate(lines):
        module = tmp_path / f"planted_{number}.py"
        module.write_text(line)
        found.append(imports_session(module))
    assert found == [True, True, True, True, False]
