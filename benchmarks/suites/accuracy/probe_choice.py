"""The advice of a quick look which probe to take, against whole scans with each probe.

Each patient of the realistic world is scanned upright and tilted with each probe. Two probes differ
where one covers more of the inner map by more than ``APART``. With the seeds nothing was tuned; the
last ones are patients with hard and sharp bone.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.metric import Metric, Progress
from rona_core.app.procedure import stages
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.compose import new_workbench, run_demo
from rona_core.devices.probes import PROBE_DATA
from rona_core.ultrasound.detection.probe_choice import QuickLook, advise

SEEDS: Sequence[int] = (*range(61_200, 61_223), 61_293, 61_297, 61_313, 61_323)
APART = 0.05  # of the region, by which coverages differ
TO_MAPS = stages("maps", skip=("caliper",))


@dataclass(frozen=True, slots=True)
class Choice:
    """Coverage of the inner map with each probe, and which one is advised where one is chosen."""

    coverage: dict[str, float]
    advised: dict[str, str]

    def kind(self, used: str) -> tuple[str, str]:
        """Return what would be right where one probe is chosen, and what is said.

        ``"keep"`` where no probe covers more than the chosen one by more than ``APART``.
        """
        best = max(self.coverage, key=lambda name: self.coverage[name])
        better = self.coverage[best] - self.coverage[used] > APART
        said = "change" if self.advised[used] != used else "keep"
        return "change" if better else "keep", said


def run(progress: Progress) -> list[Metric]:
    """Return how often the advice is right, and how often it is reversed."""
    return list(metrics([chosen(seed, progress) for seed in SEEDS]))


def chosen(seed: int, progress: Progress) -> Choice:
    """Return what whole scans of one patient cover, and what the quick look advises."""
    coverage: dict[str, float] = {}
    look: QuickLook | None = None
    for probe in PROBE_DATA:
        progress(f"seed {seed}, {probe}")
        session, figures = run_demo(seed, probe=probe, among=TO_MAPS)
        found = figures.get("inner_coverage_fraction")
        coverage[probe] = float(found) if isinstance(found, int | float) else 0.0
        if look is None:
            bench = new_workbench(session)
            held = bench.run(StartQuickLook()).results.get("quick_look")
            look = None if held is None else held.value
            bench.close()
    if not isinstance(look, QuickLook):
        return Choice(coverage, {probe: probe for probe in PROBE_DATA})
    return Choice(coverage, {probe: advise(look, probe).advised for probe in PROBE_DATA})


def metrics(found: Sequence[Choice]) -> Iterator[Metric]:
    """Yield the shares, of each patient and each probe that may be chosen."""
    counts = Counter(one.kind(used) for one in found for used in one.coverage)
    for right in ("change", "keep"):
        total = sum(counts[right, said] for said in ("change", "keep"))
        name = f"advice is right, of {total} where it is right to {right}"
        share = counts[right, right] / total if total else None
        yield Metric(name, share, "share", "higher", 1.0 if total else None)
    yield Metric("advice to take the probe that covers less", _reversed(found), "", "lower", 0.0)


def _reversed(found: Sequence[Choice]) -> int:
    """Return in how many patients a probe is advised that covers less by more than ``APART``."""
    return sum(
        one.coverage[used] - one.coverage[one.advised[used]] > APART
        for one in found
        for used in one.coverage
    )
