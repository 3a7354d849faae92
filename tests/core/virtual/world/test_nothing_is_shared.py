"""The world takes its numbers from nowhere that an algorithm takes them from."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[4]
ALGORITHMS = ("calibration", "mapping", "path", "robot", "surface", "ultrasound")
# What both may know: how long records are, what a maker tells of its probe and arm, and gravity.
TOLD = {
    "FACE_OVER_APERTURE",  # size of the line's face
    "GRAVITY_BASE",
    "GRID",
    "SPREAD",  # of the shapes that an arm is drawn with
    "WINDOW",
}


def constants_taken():
    """Yield module and name of each constant of an algorithm that the virtual world imports."""
    for path in (ROOT / "rona_core" / "virtual").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            parts = node.module.split(".")
            if len(parts) > 1 and parts[0] == "rona_core" and parts[1] in ALGORITHMS:
                for alias in node.names:
                    if alias.name.isupper():
                        yield path.relative_to(ROOT).as_posix(), alias.name


def test_the_world_imports_no_constant_of_an_algorithm():
    taken = set(constants_taken())
    assert {(path, name) for path, name in taken if name not in TOLD} == set()
    assert {name for _, name in taken} == TOLD  # and nothing is allowed that nobody needs
