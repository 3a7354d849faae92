"""Every predicted sigma held against the truth, in the realistic world that no algorithm knows.

Each case is a module with ``SEEDS`` and ``judge(seed)``. Nothing was tuned on its seeds. A session
that is refused has no samples; how many those are stands with the case.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType

from benchmarks.metric import Metric, Progress
from benchmarks.suites.honesty import latency, maps, maps_at_1_mhz, navigation, thickness
from benchmarks.suites.honesty.judged import Judged, grouped, honesty, rows
from rona_core.errors import RonaError

CASES: Mapping[str, ModuleType] = {
    "navigation": navigation,
    "latency": latency,
    "maps": maps,
    "maps at 1 MHz": maps_at_1_mhz,
    "thickness": thickness,
}


def run(progress: Progress) -> list[Metric]:
    """Return the statistics of every quantity, and the share of seeds that were refused."""
    metrics: list[Metric] = []
    for name, found in everything(progress).items():
        metrics.append(Metric(f"{name}: share of seeds refused", found.refused, "", "lower"))
        for group in grouped(found.samples).values():
            metrics += rows(honesty(group))
    return metrics


@dataclass(frozen=True, slots=True)
class CaseSamples:
    """What a case found over its seeds."""

    samples: list[Judged]
    seeds: int
    refused: float  # share of the seeds that have no samples: a step was refused


def everything(progress: Progress) -> dict[str, CaseSamples]:
    """Return the samples of every case."""
    found: dict[str, CaseSamples] = {}
    for name, case in CASES.items():
        samples = list(samples_of(name, case, progress))
        judged = {one.seed for one in samples}
        refused = 1.0 - len(judged) / max(len(case.SEEDS), 1)
        found[name] = CaseSamples(samples, len(case.SEEDS), refused)
    return found


def samples_of(name: str, case: ModuleType, progress: Progress) -> Iterator[Judged]:
    """Yield what a case finds over its seeds."""
    for seed in case.SEEDS:
        progress(f"{name}, seed {seed}")
        try:
            yield from case.judge(seed)
        except RonaError as error:
            progress(f"{name}, seed {seed}: refused: {error}")
