"""Forms show fields as they are declared, and no panel has a number of its own beside them."""

import ast
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import rona_ui.panels
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.path.messages import GenerateScanPattern
from rona_core.app.steps.setup.messages import SetTracker
from rona_core.devices.limits import heading, limits_of
from rona_ui.panels.widgets.form import Form
from tests.helpers.ui.fake_gui import FakeGui

PANELS = Path(rona_ui.panels.__file__).parent
NUMBERS = {"add_number", "add_slider", "add_vector3"}
# numbers of the page that are no fields of a message: file -> how many, and why
OWN = {
    "layout/bars.py": (1, "position of the replay"),
    "maps/comparison.py": (3, "threshold and points of a reference, sent with its file"),
    "maps/volume.py": (5, "what the scene shows of the volume"),
    "path/smoothed_path.py": (1, "number of the selected point"),
    "roll/roll_browser.py": (1, "place along the path that is shown"),
    "scan/ascan.py": (1, "time along the record of the shown A-scan"),
    "tool/calibration.py": (1, "number of poses from the selected one on"),
    "widgets/graphs.py": (1, "position along an image"),
}
LABELLED = [
    pytest.param(kind, name, words, id=f"{kind.__name__}.{name}")
    for kind in REGISTRY.messages.values()
    for name, words in limits_of(kind).items()
    if "label" in words and "uniqueItems" not in words
]


class Recorded:
    """A gui that keeps the arguments with which its only widget was added."""

    def __init__(self) -> None:
        self.kind, self.options = "", dict[str, Any]()

    def __getattr__(self, kind: str) -> Any:
        def add(label: str, *rest: Any, **options: Any) -> Any:
            self.kind, self.options = kind, {"label": label, **options}
            return FakeGui()._add(kind.removeprefix("add_"), (label, *rest), options)

        return add


def start_of(kind: type, name: str, words: Any) -> Any:
    """Return the default of a field, or another value that it may have."""
    default = next(part.default for part in fields(kind) if part.name == name)
    if default not in (MISSING, None) or "none" in words:
        return default
    if "labels" in words:
        return next(iter(words["labels"]))
    return (
        (words["minimum"],) * 3 if "tuple" in str(get_type_hints(kind)[name]) else words["minimum"]
    )


@pytest.mark.parametrize(("kind", "name", "words"), LABELLED)
def test_a_row_has_label_range_and_value_of_its_declaration(kind: type, name: str, words: Any):
    start = start_of(kind, name, words)
    if isinstance(start, tuple) and len(start) != 3:
        pytest.skip("lists have no row")
    gui = Recorded()
    form = Form(gui)
    form.of(kind, name, **{name: start})
    assert gui.options["label"] == heading(words)
    assert form.value(name) == start
    if gui.kind in NUMBERS:
        factor = 100.0 if words.get("percent") else 1.0
        low, high = factor * words["minimum"], factor * words["maximum"]
        low = min(low, 0.0) if "none" in words else low  # 0 stands for null
        wanted = (low, high) if gui.kind == "add_number" else ((low,) * 3, (high,) * 3)
        assert (gui.options["min"], gui.options["max"]) == wanted


def test_null_and_per_cent_are_shown_and_read_back():
    gui = FakeGui()
    form = Form(gui)
    form.of(GenerateScanPattern, "radius_mm")
    form.of(SetTracker, "phantom_share")
    radius, share = gui.find("number", "Radius (mm)"), gui.find("number", "Ghost solutions (%)")
    assert form.values() == {"radius_mm": None, "phantom_share": 0.0}
    radius.value, share.value = 12.0, 7.0
    assert form.values() == {"radius_mm": 12.0, "phantom_share": 0.07}
    form.show({"radius_mm": None, "phantom_share": 0.13})
    assert (radius.value, share.value) == (0.0, 13.0)


def test_a_row_without_a_value_to_show_is_refused():
    with pytest.raises(TypeError, match="give the row a start"):
        Form(FakeGui()).of(SetTracker, "latency_ms")


def test_numbers_of_panels_are_rows_of_forms_or_of_the_page_alone():
    found: dict[str, int] = {}
    for file in sorted(PANELS.rglob("*.py")):
        name = str(file.relative_to(PANELS))
        calls = [
            node.func.attr
            for node in ast.walk(ast.parse(file.read_text("utf-8")))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
        ]
        if name != "widgets/form.py" and (count := sum(call in NUMBERS for call in calls)):
            found[name] = count
    assert found == {name: count for name, (count, _) in OWN.items()}
