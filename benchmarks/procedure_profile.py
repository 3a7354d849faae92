"""``make profile``: where the CPU time of one procedure goes, by steps and by functions.

``--seed`` chooses the procedure; ``--keep`` keeps the shares of the steps, with which the suites
``procedure`` and ``speed`` compare those of later runs.
"""

import argparse
import cProfile
import pstats
import sys
from pathlib import Path
from time import process_time

from benchmarks.timed_procedure import TimedProcedure, keep_imports, keep_shares, timed_procedure

ROOT = Path(__file__).resolve().parents[1]
DEAREST = 10
WORLD = str(ROOT / "rona_core" / "virtual")
DEEPEST = 40  # calls of libraries among themselves
Key = tuple[str, int, str]  # file, line, name of a function
Edge = tuple[int, int, float, float]  # calls, primitive calls, own and cumulated time in s
Table = dict[Key, tuple[int, int, float, float, dict[Key, Edge]]]


def by_step(timed: TimedProcedure) -> list[str]:
    """Return a line for each step, in their order."""
    lines = [f"{'step':<14}{'CPU s':>8}{'share':>8}"]
    for part, share in timed.shares().items():
        lines.append(f"{part:<14}{timed.cpu_s[part]:>8.2f}{share:>8.1%}")
    return [*lines, f"{'whole':<14}{timed.total_s:>8.2f}{1:>8.1%}"]


def by_function(stats: pstats.Stats) -> list[str]:
    """Return the functions of RONA that took most, and the share of the virtual world.

    What a function of Python or of a library takes counts where RONA called it.
    """
    table: Table = stats.stats  # type: ignore[attr-defined]
    own = own_times_s(table)
    total_s = sum(row[2] for row in table.values())
    world_s = sum(spent_s for key, spent_s in own.items() if key[0].startswith(WORLD))
    lines = [f"{'own s':>8}{'share':>8}{'calls':>9}  function (profiled: small ones look dearer)"]
    for key in sorted(own, key=lambda key: -own[key])[:DEAREST]:
        where = f"{Path(key[0]).relative_to(ROOT)}:{key[1]} {key[2]}"
        lines.append(f"{own[key]:>8.2f}{own[key] / total_s:>8.1%}{table[key][1]:>9}  {where}")
    return [*lines, f"virtual world {world_s / total_s:.1%}, the rest algorithms and program"]


def own_times_s(table: Table) -> dict[Key, float]:
    """Return the time of each function of RONA with that of the libraries it calls, in s."""
    own = {key: row[2] for key, row in table.items() if _is_ours(key)}
    left = {key: row[2] for key, row in table.items() if not _is_ours(key)}
    for _ in range(DEEPEST):
        handed: dict[Key, float] = {}
        for key, spent_s in left.items():
            callers = table[key][4]
            whole_s = sum(edge[3] for edge in callers.values())
            for caller, edge in callers.items():
                part_s = spent_s * edge[3] / whole_s if whole_s > 0.0 else 0.0
                to = own if _is_ours(caller) else handed
                to[caller] = to.get(caller, 0.0) + part_s
        left = handed
    return own


def _is_ours(key: Key) -> bool:
    return key[0].startswith((str(ROOT / "rona_core"), str(ROOT / "rona_ui")))


def main() -> int:
    """Time one procedure, then profile another of the same seed, and print both."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.procedure_profile", description=__doc__
    )
    parser.add_argument("--seed", type=int, default=0, help="of the procedure")
    parser.add_argument("--keep", action="store_true", help="keep the shares of the steps")
    options = parser.parse_args()
    keep_imports()
    timed = timed_procedure(options.seed)  # first: a profiler slows small functions most
    print("\n".join(by_step(timed)), flush=True)
    if options.keep:
        keep_shares(timed)
    profile = cProfile.Profile(process_time)
    profile.runcall(timed_procedure, options.seed)
    print("\n" + "\n".join(by_function(pstats.Stats(profile))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
