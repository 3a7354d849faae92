"""Words of the interface: the field's own, as a review of it asked for."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from rona_ui import panels
from tests.ui.layout.test_hints import Recorded, docks  # noqa: F401 (a fixture)

ROOT = Path(panels.__file__).resolve().parents[2]
# what was shown, and what it says now; None: in words that are computed
EXPECTED: tuple[tuple[str, str | None], ...] = (
    (r"\bBound \(mm\)", "Tolerance (mm)"),
    (r"\bK[123]\b", "Error metric"),
    (r"\bMost room\b", "Use pose with largest margin"),
    (r"Robot errs", "Simulate robot error"),
    (r"Own speed of sound", "Patient-specific speed"),
    (r"Press the probe on", "Force control"),
    (r"Yield above", "Soft force limit (N)"),
    (r"^Rolls \(", "Roll angles"),
    (r"^Choose$", "Select by"),
    (r"Search the roll|roll that is looked at|Where to look", "Show selected roll"),
    (r"Shoot the block", "Record on reference block"),
    (r"Measure with a caliper", "Measure with caliper"),
    (r"Forget the strokes", "Delete strokes"),
    (r"Drop the line", "Discard stroke"),
    (r"Build the cloud again", "Rebuild point cloud"),
    (r"Moved tracker", "Tracker shift (mm)"),
    (r"Tracker pole", "Tracker stand (mm)"),
    (r"To and fro", None),
    (r"From itself", "Self-clearance (mm)"),
    (r"Cold drift", "Warm-up drift (mm)"),
    (r"\bOn for \(min\)", "Warm-up time (min)"),
    (r"Two cameras", "Stereo error model"),
    (r"Dropped \(%\)", "Frame loss (%)"),
    (r"Rows and lean", "Tilt (deg)"),
    (r"Open the skull", "Cut-away window"),
    (r"% sure\b", None),
    (r"\bwedge\b", None),
    (r"behind tracker, put right|Its shift of the map", None),
    (r"Against the truth", None),
    (r"\b[Ss]urroundings\b", None),
    (r"cannot determine the answer|value cannot be used", None),
    (r"Demonstrate a meander", None),
    (r"off the bone by", None),
    (r"Nothing was added", None),
    (r"Play it\b", "Play back"),
    (r"What is made of", None),
)


def literals(path: Path) -> Iterator[str]:
    """Yield the strings of a module, without its docstrings."""
    tree = ast.parse(path.read_text("utf-8"))
    told = [
        node.body[0].value
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in told:
            yield node.value


@pytest.fixture(scope="module")
def words() -> list[str]:
    folders = ("rona_ui", "rona_core/app", "rona_core/evaluation")
    return [
        text
        for folder in folders
        for path in sorted((ROOT / folder).rglob("*.py"))
        for text in literals(path)
    ]


@pytest.mark.parametrize("old", [old for old, _ in EXPECTED])
def test_no_private_word_is_shown(words: list[str], old: str) -> None:
    assert [text for text in words if re.search(old, text)] == []


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_the_word_of_the_field_is_there_in_its_place(docks: Recorded) -> None:  # noqa: F811
    labels = {label for _, label, _, _ in docks.controls}
    assert {new for _, new in EXPECTED if new is not None} - labels == set()
