"""``python -m benchmarks.reference.speed_against [COMMIT]``: the procedure now and then, in turn.

Each runs `rona_core.compose.run_demo` of a seed in a process of its own with one thread, the older
one from a worktree of the commit, with the packages of this environment. What else the machine does
meanwhile slows both, so that their ratio tells more than either CPU time.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BEFORE = "9d90310"  # the last one before the virtual world was put into batches
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# What was imported is kept out of the search for garbage, as `rona` does when it starts. Commits
# from before the realistic world know but what is called nominal now.
PROGRAM = """
import gc, sys
from time import process_time
from rona_core.compose import run_demo
try:
    from rona_core.devices.world_settings import NOMINAL_WORLD
    settings = {"world": NOMINAL_WORLD}
except ImportError:
    settings = {}
gc.collect()
gc.freeze()
start = process_time()
run_demo(int(sys.argv[1]), **settings)
print(process_time() - start)
"""


@contextmanager
def checked_out(commit: str) -> Generator[Path]:
    """Give a folder with the files of a commit while this lasts."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def cpu_s(tree: Path, seed: int) -> float:
    """Return the CPU time of a whole procedure, in s, by the program in a folder."""
    environment = {**os.environ, "PYTHONPATH": str(tree), **dict.fromkeys(THREADS, "1")}
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(seed)],
        cwd=tree,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return float(found.stdout.split()[-1])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both times of each seed, their ratio, and the median of the ratios."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("commit", nargs="?", default=BEFORE)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    options = parser.parse_args(arguments)
    ratios: list[float] = []
    with checked_out(options.commit) as tree:
        for seed in options.seeds:
            first = cpu_s(ROOT, seed)
            before = cpu_s(tree, seed)
            now = 0.5 * (first + cpu_s(ROOT, seed))  # as much before as after the other one
            ratios.append(before / now)
            print(
                f"seed {seed}: {options.commit} {before:.1f} s, now {now:.1f} s, {ratios[-1]:.2f}"
            )
    print(f"median of {len(ratios)}: {statistics.median(ratios):.2f} times as fast")


if __name__ == "__main__":
    main()
