"""What if probe, excitation or noise were others: what is asked for, and what came of it.

The bone is a layered plate as in a skull, and nobody's specimen.
"""

from dataclasses import dataclass

from rona_core.devices.settings import Excitation, ProbeName
from rona_core.geometry.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class WhatIfGrid:
    """What is swept: every probe, excitation, noise and thickness with every other."""

    probes: tuple[ProbeName, ...] = ("2.25MHz", "1MHz")
    excitations: tuple[Excitation, ...] = ("pulse", "chirp")
    snr_db: tuple[float, ...] = (30.0, 50.0)
    thickness_mm: tuple[float, ...] = (3.0, 5.0, 8.0, 11.0)
    kind: str = "normal"  # of the bone, see ``medium.MEDIA``
    n: int = 40  # A-scans in each cell

    @property
    def cells(self) -> tuple[tuple[ProbeName, Excitation, float, float], ...]:
        """Every combination, the thickness running fastest."""
        return tuple(
            (probe, excitation, snr, thickness)
            for probe in self.probes
            for excitation in self.excitations
            for snr in self.snr_db
            for thickness in self.thickness_mm
        )


@dataclass(frozen=True, slots=True, eq=False)
class WhatIf:
    """How detection did in each cell (c,); sd and bias are 0 where ``n_right`` is below 2."""

    probes: tuple[str, ...]  # (c,)
    excitations: tuple[str, ...]  # (c,)
    snr_db: Floats
    thickness_mm: Floats
    failures: Floats  # share of A-scans that are more than 1 mm off, flagged or not
    unflagged: Floats  # share of those that claim to be right and are not
    coverage: Floats  # share of A-scans that claim to be right
    sd_mm: Floats  # of those that claim it and are
    bias_mm: Floats
    n_right: Ints  # how many those are
    kind: str
    n: int
