"""Maps and A-scans of the 1 MHz probe against the truth, in the realistic world."""

from collections.abc import Iterator
from dataclasses import replace

from benchmarks.suites.honesty import maps
from benchmarks.suites.honesty.design import session_of
from benchmarks.suites.honesty.judged import Judged

SEEDS = range(41_600, 41_648)


def judge(seed: int) -> Iterator[Judged]:
    """Yield errors and predicted sigmas of one session, named as those of this probe.

    Raises:
        RonaError: the procedure did not come to its end.
    """
    session = session_of(seed, probe="1MHz")
    for one in (*maps.maps(session, seed), *maps.ascans(session, seed)):
        yield replace(one, quantity=f"1 MHz, {one.quantity}")
