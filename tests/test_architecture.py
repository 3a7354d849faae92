"""The rules of docs/architecture.md that a machine can check, and proof that it does check them."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers import frame_names
from tests.tools import structure

pytestmark = pytest.mark.slow  # `make check` runs all of it

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("rona_core", "rona_ui")
OTHERS = ("benchmarks", "examples", "tests")
LINT = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"


def modules(*folders: str, root: Path = ROOT) -> list[Path]:
    return sorted(p for folder in folders for p in (root / folder).rglob("*.py"))


def lint_imports(folder: Path) -> tuple[int, str]:
    """Run import-linter with the contracts of ``folder`` on the packages in it."""
    run = subprocess.run(
        [sys.executable, "-c", LINT],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )
    return run.returncode, run.stdout + run.stderr


# -- the product keeps the rules -------------------------------------------------------------------


def test_import_contracts_hold():
    code, output = lint_imports(ROOT)
    assert code == 0, output


@pytest.mark.parametrize("folder", [*PRODUCT, "benchmarks", "examples"])
def test_neighbouring_frames_cancel(folder):
    errors = list(frame_names.check_folder(ROOT / folder, ROOT))
    assert not errors, "\n".join(errors)


def test_the_library_neither_asserts_nor_prints():
    found = []
    for path in modules(*PRODUCT):
        if not re.search(r"\b(assert|print)\b", path.read_text("utf-8")):
            continue
        for node in ast.walk(structure.tree(path)):
            is_print = (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id == "print"
                and path != ROOT / "rona_ui" / "cli.py"  # it speaks to a terminal
            )
            if is_print or isinstance(node, ast.Assert):
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert not found


def is_a_set(node: ast.AST) -> bool:
    """Whether an expression is visibly a set, whose order differs from process to process."""
    if isinstance(node, ast.BinOp):
        return is_a_set(node.left) or is_a_set(node.right)
    called = node.func if isinstance(node, ast.Call) else None
    named = isinstance(called, ast.Name) and called.id in ("set", "frozenset")
    return named or isinstance(node, ast.Set | ast.SetComp)


def ordered_by_sets(tree: ast.AST) -> Iterator[int]:
    """Yield the lines of loops and lists that follow the order of a set."""
    for node in ast.walk(tree):
        over = [node.iter] if isinstance(node, ast.For) else []
        if isinstance(node, ast.ListComp | ast.DictComp | ast.GeneratorExp):
            over = [part.iter for part in node.generators]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            over = node.args if node.func.id in ("list", "tuple", "enumerate") else []
        yield from (node.lineno for one in over if is_a_set(one))


def test_nothing_follows_the_order_of_a_set():
    """It differs between processes, and so would the bits of what follows it."""
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in modules("rona_core")
        for line in ordered_by_sets(structure.tree(path))
    ]
    assert not found


@pytest.mark.parametrize(
    "source",
    [
        "[x for x in {*names}]",
        "for x in set(names): pass",
        "list(set(a) | set(b))",
        "dict((x, 1) for x in {a, b})",
    ],
)
def test_an_order_by_a_set_is_found(source):
    assert list(ordered_by_sets(ast.parse(source))) == [1]
    assert not list(ordered_by_sets(ast.parse("sorted({*names}); {x for x in names}")))


def test_what_the_bone_is_made_of_is_read_by_the_virtual_devices_alone():
    """No computation looks at the choice of bone: it is set, shown, digested and made."""
    allowed = {"compose.py", "capture_parts.py", "workbench.py", "setup_handlers.py", "setup.py"}
    allowed |= {"scan_metrics.py"}  # it judges against the truth
    choice = re.compile(r"\bsetup\.bone\b")
    readers = {p.name for p in modules(*PRODUCT) if choice.search(p.read_text("utf-8"))}
    assert readers <= allowed
    assert "compose.py" in readers


def test_nothing_is_left_for_later():
    marks = re.compile(r"\b(TODO|FIXME|XXX|HACK)\b|raise NotImplementedError")
    files = [p for p in modules(*PRODUCT, *OTHERS) if p != Path(__file__)]
    found = [str(p.relative_to(ROOT)) for p in files if marks.search(p.read_text("utf-8"))]
    assert not found


def test_no_path_of_somebodys_machine():
    home = re.compile(r"(?<![\w.~])/(?:work|home|root|Users|mnt)/\w|[A-Z]:\\\\?Users")
    texts = [*modules(*PRODUCT, *OTHERS), *(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.*")]
    found = []
    for path in texts:
        if path.is_file() and path != Path(__file__) and path.suffix in {".py", ".md", ".toml"}:
            for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
                if home.search(line):
                    found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found, "\n".join(found)


def imported(path: Path) -> set[str]:
    """Return the modules that a file imports."""
    nodes = list(ast.walk(structure.tree(path)))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}


def test_the_product_imports_neither_tests_nor_benchmarks():
    found = {path: imported(path) for path in modules(*PRODUCT)}
    assert not [
        (path, name)
        for path, names in found.items()
        for name in names
        if name.partition(".")[0] in OTHERS
    ]


def test_tests_take_nothing_but_reference_implementations_from_the_benchmarks():
    elsewhere = [p for p in modules("tests") if p.parts[len(ROOT.parts) + 1] != "benchmarks"]
    assert not [
        (path, name)
        for path in elsewhere
        if "benchmarks" in path.read_text("utf-8")
        for name in imported(path)
        if name.partition(".")[0] == "benchmarks" and not name.startswith("benchmarks.reference.")
    ]


def test_rooms_import_one_another_one_way():
    assert not structure.circles(ROOT, *PRODUCT)


def test_functions_have_few_parameters_and_lines():
    assert not structure.wide_functions(ROOT, *PRODUCT)
    assert not structure.long_functions(ROOT, *PRODUCT)


def test_circles_and_wide_functions_are_found(tmp_path):
    for room in ("one", "two"):
        (tmp_path / "pkg" / room).mkdir(parents=True)
        (tmp_path / "pkg" / room / "__init__.py").touch()
    (tmp_path / "pkg" / "__init__.py").touch()
    (tmp_path / "pkg" / "one" / "a.py").write_text("import pkg.two.b\n")
    (tmp_path / "pkg" / "two" / "b.py").write_text("def f(): from pkg.one import a\n")
    (tmp_path / "pkg" / "c.py").write_text(
        "class C:\n  def f(self, a, b, c, d, e, f, *, g, h): ...\n"
    )
    assert structure.circles(tmp_path, "pkg") == ["pkg: one <-> two"]
    assert structure.wide_functions(tmp_path, "pkg") == ["pkg/c.py:2 f: 8"]


def test_a_walk_enters_the_files_that_a_parameter_is_passed_to(tmp_path):
    for name, text in {
        "a": "from b import f\ndef start(s, n): f(n, held=s); other(s)\ndef other(s): f(1, s)\n",
        "b": "from c import D\ndef f(n, held): return D(held), g(n)\ndef g(n): ...\n",
        "c": "class D:\n  def __init__(self, held): ...\n",
    }.items():
        (tmp_path / f"{name}.py").write_text(text)
    walk = structure.Walk(tmp_path, "a", "start")
    assert walk.entered == ["a", "b", "c"]
    assert walk.returns == 4, "c to b, b to a, b once more, and back"


def test_test_files_have_names_of_their_own():
    names = [p.name for p in modules("tests") if p.name.startswith("test_")]
    assert sorted(names) == sorted(set(names))


# -- planted violations are caught -----------------------------------------------------------------

PLANTED_IMPORTS = [
    ("rona_core/devices/planted.py", "import viser", "no viewer and no web framework"),
    ("rona_core/geometry/planted.py", "import rona_core.devices.live", "Layers of rona_core"),
    ("rona_core/path/planted.py", "import rona_core.calibration.pivot", "Layers of rona_core"),
    ("rona_core/path/planted.py", "import benchmarks.reference", "neither tests nor benchmarks"),
    ("rona_core/app/planted.py", "import rona_core.virtual", "ground truth"),
    ("rona_core/app/planted.py", "import rona_core.evaluation", "Layers of rona_core"),
    ("rona_core/app/runtime/store.py", "import rona_core.app.steps.tool.step", "Rooms of the app"),
    (
        "rona_core/app/steps/tool/step.py",
        "import rona_core.app.overview.acceptance",
        "Rooms of the",
    ),
    ("rona_core/app/steps/scan/step.py", "import rona_core.app.steps.maps.messages", "Steps: each"),
    ("rona_core/planted.py", "", "Layers of rona_core"),  # a new module must choose a layer
    ("rona_core/arrays_user.py", "import rona_ui", "does not know the interface"),
    (
        "rona_core/ultrasound/detection/detect.py",
        "import rona_core.virtual.acoustics.echo_model",
        "ground truth",
    ),
    (
        "rona_core/virtual/acoustics/echo_model.py",
        "import rona_core.ultrasound.detection",
        "generator of echoes",
    ),
    (
        "rona_core/robot/verification/verifier.py",
        "import rona_core.robot.redundancy",
        "verifier knows no planner",
    ),
    (
        "rona_core/robot/verification/motion_checks.py",
        "import rona_core.robot.trajectory.scan_timing",
        "verifier knows no planner",
    ),
    (
        "rona_core/robot/collision/edge_check.py",
        "import rona_core.robot.redundancy",
        "Rooms of the robot",  # else the verifier knew a planner through the collision bodies
    ),
    (
        "rona_core/robot/collision/collision_geometry.py",
        "import rona_core.robot.meshes",
        "Collision bodies do not depend on what is drawn",
    ),
    ("rona_core/robot/kinematics/rx90.py", "import rona_core.robot.planning", "Rooms of the robot"),
    (
        "rona_core/ultrasound/detection/single/inner_echo.py",
        "import rona_core.ultrasound.detection.spatial",
        "Rooms of detection",
    ),
    ("rona_core/study/planted_engine.py", "", "Rooms of a study"),  # a new module must choose
    ("rona_core/study/engines.py", "import rona_core.study.folder", "Rooms of a study"),
    ("rona_core/compose.py", "import rona_core.study", "Layers of rona_core"),
    ("rona_core/study/report.py", "import distributed", "Dask is an extra"),
    ("rona_ui/panels/planted.py", "import rona_core.path", "only through rona_core.app"),
    ("rona_ui/api/planted.py", "import rona_core.robot", "only through rona_core.app"),
    ("rona_ui/panels/planted.py", "import rona_core.virtual", "only through compose"),
    ("rona_ui/panels/widgets/form.py", "import rona_ui.panels.layout", "Panels: a room a step"),
    ("rona_ui/scene/cut_plane.py", "import rona_ui.panels", "Layers of rona_ui"),
    ("rona_ui/panels/surface.py", "import rona_ui.scene.viser_nodes", "Layers of rona_ui"),
    ("rona_ui/presentation/colors.py", "import rona_ui.scene", "Layers of rona_ui"),
]


def test_every_module_that_times_a_motion_is_kept_from_the_verifier():
    """A new module of trajectory has to be forbidden, too: shared are the motion and its task."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    verifier = next(c for c in contracts["contracts"] if c["id"] == "verifier-without-planner")
    room = ROOT / "rona_core" / "robot" / "trajectory"
    named = {path.stem for path in room.glob("*.py")} - {"__init__", "trajectory", "cutting_path"}
    forbidden = {name.rpartition(".")[2] for name in verifier["forbidden_modules"]}
    assert named <= forbidden


def dotted(module: str) -> str:
    return module.removesuffix(".py").replace("/", ".")


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """Return what each broken contract says of a skeleton that has all planted imports.

    It is our contracts, our packages, and every module in them without its contents.
    """
    top = tmp_path_factory.mktemp("skeleton")
    shutil.copy(ROOT / "pyproject.toml", top)
    for path in modules(*PRODUCT):
        (top / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        (top / path.relative_to(ROOT)).touch()
    for module, line, _ in PLANTED_IMPORTS:
        with (top / module).open("a") as file:
            file.write(f"{line}\n")
    code, output = lint_imports(top)
    assert code == 1, output
    _, _, output = output.partition("Broken contracts")
    titles_and_reports = re.split(r"^(\S.*)\n-{5,}$", output, flags=re.MULTILINE)
    return dict(zip(titles_and_reports[1::2], titles_and_reports[2::2], strict=True))


@pytest.mark.parametrize(("module", "line", "contract"), PLANTED_IMPORTS)
def test_a_planted_import_is_caught(broken, module, line, contract):
    reports = [report for title, report in broken.items() if contract in title]
    imported = re.escape(line.removeprefix("import ").partition(".reference")[0])
    what = rf" -> {imported} \(l" if line else ""  # a module without imports must choose a layer
    assert re.search(rf"^- +{re.escape(dotted(module))}{what}", "".join(reports), re.MULTILINE)


def test_no_import_is_reported_that_was_not_planted(broken):
    reported = re.findall(r"^- +([\w.]+)", "".join(broken.values()), re.MULTILINE)
    assert set(reported) == {dotted(module) for module, _, _ in PLANTED_IMPORTS}


WRONG_FRAMES = {
    "inner words differ": "T_base_tip = T_base_flange @ T_probe_tip",
    "result differs": "T_base_probe = T_base_flange @ T_flange_tip",
    "inverse forgotten": "T_base_tip = T_flange_base @ T_flange_tip",
    "inverse too many": "T_base_tip = T_base_flange.inv() @ T_flange_tip",
    "swapped": "T_tracker_base = T_base_tracker",
    "batch": "Ts_base_marker = T_base_tip @ Ts_tracker_marker",
    "chain of three": "T_base_tip = T_base_tracker @ T_tracker_toolmarker @ T_tip_toolmarker",
    "points": "p = T_base_skull @ points_mesh",
    "points in the wrong name": "points_skull = T_base_skull @ points_skull",
    "direction": "n = T_base_skull.rotate(normals_base)",
    "rotation matrix": "n = T_base_skull.rotation.T @ axis_skull",
    "translation": "tip_tracker = T_base_tip.translation",
    "column of a rotation": "axis_probe = T_base_probe.rotation[:, 2]",
    "attribute": "self.T_base_tip = scene.T_base_probe",
    "call": "T_base_tracker = display.T_base_skull()",
    "argument": "move(T_base_tip=T_base_flange)",
    "argument made on the spot": "move(points_base=T_skull_base @ points_base)",
    "one of several": "n, T_base_tip = 1, T_base_probe",
    "loop": "for T_base_tip in Ts_base_probe: pass",
    "comprehension": "xs = [f(T_base_tip) for T_base_tip in Ts_base_probe]",
    "returned": "def T_base_tip(self): return self.T_base_flange",
    "returned product": "def f(): return T_base_flange @ T_tip_flange",
    "points for a pose": "T_base_tip = T_base_tip @ points_tip",
    "another tool's marker": "T_tracker_pointermarker = T_tracker_toolmarker",
    "unknown word": "T_world_tip = x",
    "unknown word in an argument": "def f(T_base_gripper): pass",
    "unknown word in a field": "class A:\n    T_hand_eye: Pose",
    "one word": "T_base = x",
    "three frames": "T_base_tip_flange = x",
}

RIGHT_FRAMES = [
    "T_base_tip = T_base_flange @ T_flange_tip",
    "T_base_tip = T_flange_base.inv() @ T_tip_flange.inv()",
    "T_base_tip_true = T_base_tip_nominal @ T_tip_tip",
    "points_base = T_base_skull @ points_skull",
    "normals_base = T_base_skull.rotate(-normals_skull)",
    "Ts_base_marker = T_base_tracker @ track.Ts_tracker_marker",
    "T_tracker_toolmarker = frame.tool(name).T_tracker_marker",
    "T_b_a = fit(points_a, points_b)",
    "register_points(points_a=points_base, points_b=points_skull)",
    "tip_base = T_base_tip.translation + T_base_tip.rotate(offset_tip)",
    "axis_base = Ts_base_probe.rotations[:, :, 2]",
    "points_skull = T_base_skull.inv() @ points_base",
    "T_base_tip = Ts_base_tip[3]",
    "T_base_tracker = x if fixed else T_base_tracker",
    "value = A @ points_base.T",
    "T = TypeVar('T'); T_co = TypeVar('T_co')",
    "mesh = skull_mesh; probe = 3; n_probe = count",
    "true_tip = T_base_tip.translation",
]


@pytest.mark.parametrize("source", WRONG_FRAMES.values(), ids=WRONG_FRAMES)
def test_a_wrong_frame_is_caught(source):
    errors = frame_names.check_source(f"\n{source}\n", "planted.py")
    assert len(errors) == 1, errors
    assert errors[0].startswith(("planted.py:2: ", "planted.py:3: "))


@pytest.mark.parametrize("source", RIGHT_FRAMES)
def test_right_frames_pass(source):
    assert frame_names.check_source(source, "planted.py") == []


def test_every_frame_word_is_explained():
    text = (ROOT / "docs" / "conventions.md").read_text("utf-8")
    missing = [w for w in frame_names.FRAMES if len(w) > 1 and f"| `{w}` |" not in text]
    assert not missing
