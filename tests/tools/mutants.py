"""Mutation testing: change one thing in a module, run the tests that execute it, expect a failure.

``python -m tests.tools.mutants`` takes a seeded sample of every module in ``TARGETS``; ``--all``
takes every mutant, ``--only verification`` one target. Nothing is written into the tree: a forked
process loads the changed module in the place of the real one. Tests are chosen by the lines they
execute, among the quick ones. A mutant is killed if a test fails or does not end.
"""

import argparse
import ast
import contextlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.tools.mutations import changes

ROOT = Path(__file__).resolve().parents[2]
# target -> modules that are changed, tests that shall notice
TARGETS = {
    "verification": (
        "rona_core/robot/verification/*.py",
        ("tests/core/robot/verification",),
    ),
    "store": (
        "rona_core/app/runtime/store.py",
        ("tests/app/runtime/test_store.py", "tests/app/runtime/test_autosave.py"),
    ),
    "session_files": (
        "rona_core/session/{files,members,codec}.py",
        (
            "tests/core/session",
            "tests/app/dependencies/test_capture_digests.py",
            "tests/app/runtime/test_autosave.py",
        ),
    ),
    "judge": (
        "rona_core/app/dependencies/{judge,staleness}.py",
        ("tests/app/dependencies", "tests/app/procedures/test_next_stage.py"),
    ),
    "pivot": (
        "rona_core/calibration/pivot/*.py",
        (
            "tests/core/calibration/pivot",
            "tests/core/calibration/handheld",
            "tests/core/calibration/test_repeating_errors.py",
        ),
    ),
}
# imported once, before processes are forked; nothing of the product or of the tests
PRELOADED = "numpy scipy.optimize scipy.spatial scipy.linalg scipy.stats pinocchio trimesh h5py"
PRELOADED += " hypothesis.strategies hypothesis.extra.numpy pytest _pytest.assertion.rewrite"
EACH = 40  # mutants a module
GRACE_S = 15.0


@dataclass(frozen=True)
class Mutant:
    """One change of a module: which of its possible changes, where, and what it does."""

    target: str
    module: Path
    index: int
    lines: range
    change: str

    def __str__(self) -> str:
        return f"{self.module.relative_to(ROOT)}:{self.lines[0]}: {self.change}"

    def tree(self) -> ast.Module:
        """Return the changed module."""
        tree = ast.parse(self.module.read_text("utf-8"))
        for index, (_, change) in enumerate(changes(tree)):
            if index == self.index:
                change()
                return ast.fix_missing_locations(tree)
        raise LookupError(self)


def mutants(target: str, module: Path) -> list[Mutant]:
    """Return all mutants of a module."""
    tree = ast.parse(module.read_text("utf-8"))
    places = [range(node.lineno, node.end_lineno + 1) for node, _ in changes(tree)]
    before = ast.unparse(tree).splitlines()
    found: list[Mutant] = []
    for index, lines in enumerate(places):
        after = ast.unparse(Mutant(target, module, index, lines, "").tree()).splitlines()
        k = next(k for k, (a, b) in enumerate(zip(before, after, strict=False)) if a != b)
        text = f"{before[k].strip()}  ->  {after[k].strip()}"
        found.append(Mutant(target, module, index, lines, text))
    return found


# -- tests, in forked processes --------------------------------------------------------------------


@dataclass
class Recorder:
    """Plugin of pytest: which test executes which line of the modules, and how long it takes.

    What a fixture executes counts for all tests of its file.
    """

    modules: frozenset[str]
    executed: dict[str, set[str]] = field(default_factory=dict)  # "module:line" -> tests, files
    seconds: dict[str, float] = field(default_factory=dict)
    now: str = ""

    def trace(self, frame, event, _):
        """Follow only frames of the modules."""
        return self.line if frame.f_code.co_filename in self.modules else None

    def line(self, frame, event, _):
        """Note a line."""
        key = f"{frame.f_code.co_filename}:{frame.f_lineno}"
        self.executed.setdefault(key, set()).add(self.now)
        return self.line

    def pytest_runtest_logstart(self, nodeid):
        self.now = nodeid.partition("::")[0]

    def pytest_runtest_call(self, item):
        self.now = item.nodeid

    def pytest_runtest_teardown(self, item):
        self.now = item.nodeid.partition("::")[0]

    def pytest_runtest_logreport(self, report):
        before = self.seconds.get(report.nodeid, 0.0)
        self.seconds[report.nodeid] = before + report.duration


class Loader(importlib.abc.MetaPathFinder, importlib.machinery.SourceFileLoader):
    """Loads one module from a changed tree."""

    def __init__(self, mutant: Mutant) -> None:
        name = ".".join(mutant.module.relative_to(ROOT).with_suffix("").parts)
        super().__init__(name, str(mutant.module))
        self._code = compile(mutant.tree(), str(mutant.module), "exec", dont_inherit=True)

    def get_code(self, fullname):
        """Return the changed code."""
        return self._code

    def find_spec(self, fullname, path=None, target=None):
        """Find the one module."""
        if fullname == self.name:
            return importlib.util.spec_from_file_location(fullname, self.path, loader=self)
        return None


def fork(work: Callable[[], int], folder: Path) -> int:
    """Run ``work`` in a process of its own, silent; return its id."""
    pid = os.fork()
    if pid:
        return pid
    status = 99
    try:
        os.setsid()
        folder.mkdir(parents=True, exist_ok=True)
        out = os.open(folder / "out", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        status = work()
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(status)


def run_pytest(tests: list[str], folder: Path, *options: str, plugins: tuple = ()) -> int:
    """Run tests in this process."""
    import pytest

    plain = ["-q", "-m", "not slow", "-p", "no:cacheprovider", f"--basetemp={folder / 'tmp'}"]
    plain += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of what was preloaded
    return int(pytest.main([*plain, *options, *tests], plugins=list(plugins)))


def record(modules: list[Path], tests: tuple[str, ...], folder: Path) -> Recorder:
    """Run the tests once and return what they execute."""
    recorder = Recorder(frozenset(map(str, modules)))

    def work() -> int:
        threading.settrace(recorder.trace)
        sys.settrace(recorder.trace)
        status = run_pytest(list(tests), folder, plugins=(recorder,))
        sys.settrace(None)
        executed = {key: sorted(names) for key, names in recorder.executed.items()}
        (folder / "found.json").write_text(json.dumps([executed, recorder.seconds]))
        return status

    _, status = os.waitpid(fork(work, folder), 0)
    if status:
        raise SystemExit(f"the tests fail unchanged:\n{(folder / 'out').read_text()[-3000:]}")
    executed, recorder.seconds = json.loads((folder / "found.json").read_text())
    recorder.executed = {key: set(names) for key, names in executed.items()}
    return recorder


def chosen(mutant: Mutant, recorder: Recorder) -> list[str]:
    """Return the tests that execute a mutant, the quick ones of quick files first."""
    names: set[str] = set()
    for line in mutant.lines:
        names |= recorder.executed.get(f"{mutant.module}:{line}", set())
    # "" is an import: what is computed there may be used by any test
    tests = [
        test
        for test in recorder.seconds
        if "" in names or test in names or test.partition("::")[0] in names
    ]
    total: Counter[str] = Counter()
    for test in tests:
        total[test.partition("::")[0]] += recorder.seconds[test]
    return sorted(tests, key=lambda test: (total[test.partition("::")[0]], recorder.seconds[test]))


def run(mutant: Mutant, tests: list[str], folder: Path) -> int:
    """Return the exit status of the tests with a mutant."""
    sys.meta_path.insert(0, Loader(mutant))
    return run_pytest(tests, folder, "-x", "--no-header", "--tb=no")


def survivors(todo: list[tuple[Mutant, list[str], float]], jobs: int, folder: Path) -> list[Mutant]:
    """Run mutants, some at a time; return those that no test notices.

    Args:
        todo: Mutants with their tests and how long these take.
        jobs: How many at a time.
        folder: For what tests write.
    """
    waiting, running, alive = list(reversed(todo)), {}, []
    while waiting or running:
        while waiting and len(running) < jobs:
            mutant, tests, seconds = waiting.pop()
            if not tests:
                alive.append(mutant)
                continue
            place = folder / f"{mutant.module.stem}_{mutant.index}"
            pid = fork(lambda m=mutant, t=tests, p=place: run(m, t, p), place)
            running[pid] = (mutant, place, time.monotonic() + 4.0 * seconds + GRACE_S)
        time.sleep(0.01)
        for pid, (mutant, place, end) in list(running.items()):
            late = time.monotonic() > end
            if late:
                os.killpg(pid, signal.SIGKILL)
            done, status = os.waitpid(pid, 0 if late else os.WNOHANG)
            if done:
                del running[pid]
                shutil.rmtree(place, ignore_errors=True)
                if status == 0:
                    alive.append(mutant)
    return alive


def main(arguments: list[str] | None = None) -> int:
    """Print how many mutants were killed, and the survivors."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.mutants", description=__doc__)
    parser.add_argument("--all", action="store_true", help="every mutant, not a sample")
    parser.add_argument("--each", type=int, default=EACH, help="mutants a module (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", choices=sorted(TARGETS), help="one target")
    options = parser.parse_args(arguments)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for name in PRELOADED.split():
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    alive: list[Mutant] = []
    count = 0
    with tempfile.TemporaryDirectory() as temporary:
        for target in [options.only] if options.only else TARGETS:
            start, folder = time.monotonic(), Path(temporary) / target
            pattern, tests = TARGETS[target]
            modules = matching(pattern)
            recorder = record(modules, tests, folder)
            todo = []
            for module in modules:
                found = mutants(target, module)
                if not options.all and len(found) > options.each:
                    found = random.Random(f"{options.seed} {module.name}").sample(
                        found, options.each
                    )
                for mutant in sorted(found, key=lambda m: m.index):
                    names = chosen(mutant, recorder)
                    todo.append((mutant, names, sum(recorder.seconds[n] for n in names)))
            left = survivors(todo, options.jobs, folder)
            alive += left
            count += len(todo)
            spent = time.monotonic() - start
            killed = len(todo) - len(left)
            print(f"{target}: {killed} of {len(todo)} killed ({spent:.0f} s)", flush=True)
            for mutant in sorted(left, key=str):
                print(f"  {mutant}", flush=True)
    share = 100.0 * (count - len(alive)) / max(count, 1)
    print(f"all: {count - len(alive)} of {count} killed, {share:.1f} %")
    return 0


def matching(pattern: str) -> list[Path]:
    """Return the modules that a pattern means, with one {a,b} in it."""
    head, brace, rest = pattern.partition("{")
    names, _, tail = rest.partition("}")
    patterns = [head + name + tail for name in names.split(",")] if brace else [pattern]
    return sorted(p for one in patterns for p in ROOT.glob(one) if p.read_text("utf-8").strip())


if __name__ == "__main__":
    sys.exit(main())
