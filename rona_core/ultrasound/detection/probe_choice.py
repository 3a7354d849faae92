"""Which probe to take, by a quick look with each along some short lines over the region.

A look is a pass with the probe upright or tilted. How far a whole scan would map the inner boundary
is expected from the lines at which any look is sure of it, less the places whose bone is too thin
for the probe. Single A-scans do not tell: detection is sure of an echo where its neighbours have it
too. See docs/algorithms/ultrasound/probe_choice.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.detect import OK, TOO_THIN, UNSURE, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey

CLEAR = 0.16  # of the region, by which another probe is to be better: two of a dozen lines


@dataclass(frozen=True, slots=True)
class ExpectedCoverage:
    """What a scan with one probe and its tilted passes is expected to give; shares of the region.

    ``sure`` is the share of lines at which some look is sure of the inner boundary, ``thin`` that
    of places where most looks find the bone too thin for the probe.
    """

    probe: str
    coverage: float
    sure: float
    thin: float

    @property
    def words(self) -> str:
        """The coverage with the probe, and how much of the bone is too thin for it."""
        words = f"{100 * self.coverage:.0f} % with {PROBE_DATA[self.probe].title}"
        thin = round(100 * self.thin)
        return f"{words} ({thin} % is too thin for it)" if thin else words


@dataclass(frozen=True, slots=True)
class QuickLook:
    """What quick looks along the same lines say of some probes."""

    lines: int
    probes: tuple[ExpectedCoverage, ...]


@dataclass(frozen=True, slots=True)
class ProbeAdvice:
    """Which probe is to be taken, in words; the same one where no other is clearly better.

    ``used`` is the probe of the set-up.
    """

    used: str
    advised: str
    sentence: str

    @property
    def another(self) -> bool:
        """Whether another probe than that of the set-up is advised."""
        return self.advised != self.used


def compare(
    probes: Sequence[Sequence[ProbeSurvey]],
    lines: int,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> QuickLook:
    """Return what a scan with each probe is expected to cover.

    The loss of the bone is learned from all looks of the first probe that shows it: those of a
    single look are too few.

    Args:
        probes: Looks with each probe, see `expected_coverage`.
        lines: How many lines there are.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between blocks of A-scans.

    Raises:
        InvalidInputError: as `expected_coverage` raises it.
        CancelledError: ``cancel`` said so.
    """
    learned = (detect(_together(looks), cancel=cancel).bone_loss for looks in probes)
    loss = next((one for one in learned if one is not None), 1.0)
    found: list[ExpectedCoverage] = []
    for looks in probes:
        progress((1.0 + len(found)) / (1.0 + len(probes)))
        found.append(expected_coverage(looks, lines, loss, cancel=cancel))
    progress(1.0)
    return QuickLook(lines, tuple(found))


def expected_coverage(
    looks: Sequence[ProbeSurvey], lines: int, bone_loss: float, *, cancel: Cancel = never
) -> ExpectedCoverage:
    """Return what a scan is expected to cover of the region, by looks with one probe.

    Args:
        looks: A-scans (n) of each look, line after line, all lines equally long.
        lines: How many lines there are.
        bone_loss: Attenuation of the bone over the nominal one.
        cancel: Asked between blocks of A-scans.

    Raises:
        InvalidInputError: no look, or A-scans that do not come out even.
        CancelledError: ``cancel`` said so.
    """
    if not looks or any(len(one.track) != len(looks[0].track) for one in looks):
        raise InvalidInputError("quick looks need to be at the same places, and at least one")
    if lines < 1 or len(looks[0].track) % lines:
        raise InvalidInputError(f"{len(looks[0].track)} A-scans make no {lines} lines")
    found = [detect(one, bone_loss=bone_loss, cancel=cancel) for one in looks]
    shape = (len(looks), lines, -1)
    flag = np.array([one.flag for one in found]).reshape(shape)
    sure = (flag == OK).any(axis=(0, 2))
    measured = np.isin(flag, (OK, UNSURE, TOO_THIN)).sum(axis=0)
    thin = 2 * (flag == TOO_THIN).sum(axis=0) > measured
    return ExpectedCoverage(
        probe=found[0].probe,
        coverage=float((sure.repeat(thin.shape[1]) & ~thin.ravel()).mean()),
        sure=float(sure.mean()),
        thin=float(thin.mean()),
    )


def _together(looks: Sequence[ProbeSurvey]) -> ProbeSurvey:
    """Return all looks with one probe as one survey."""
    return ProbeSurvey(
        AScanTrack.joined([one.track for one in looks]),
        looks[0].probe,
        looks[0].excitation,
        positions_mm=_joined([one.positions_mm for one in looks]),
        axes=_joined([one.axes for one in looks]),
        known_standoff_mm=_joined([one.known_standoff_mm for one in looks]),
    )


def _joined(parts: Sequence[Floats | None]) -> Floats | None:
    """Return arrays one after the other; None where one of them is not known."""
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def advise(look: QuickLook, used: str) -> ProbeAdvice:
    """Return which probe to take where one is chosen already; another one if it is clearly better.

    Raises:
        InvalidInputError: no look with that probe.
    """
    known = {one.probe: one for one in look.probes}
    if used not in known:
        raise InvalidInputError(f"no quick look with {used!r}: there is {', '.join(known)}")
    best = max(look.probes, key=lambda one: one.coverage)
    expected = ", ".join(one.words for one in look.probes)
    words = f"Quick look: inner boundary of the region expected to {expected}."
    if best.coverage - known[used].coverage < CLEAR:
        return ProbeAdvice(used, used, f"{words} No other probe is clearly better.")
    return ProbeAdvice(
        used, best.probe, f"{words} Better: the {PROBE_DATA[best.probe].title} probe."
    )
