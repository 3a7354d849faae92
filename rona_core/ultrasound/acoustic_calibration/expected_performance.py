"""Expected performance of a probe and an excitation: sigma and depth range, before measuring.

The bound of Cramer and Rao for a nominal inner echo in the receiver's noise, and the depth down to
which that echo stands out. Rough surfaces, scatter and tilt come on top: no probe does better.

A sweep tries detection with other probes, excitations and noise on a layered plate as in a skull,
made anew for every cell by the recorder; it is no specimen, and detection learns
nothing of it. Errors are of the time of flight, stated as thickness at the nominal speed, so that
the unknown speed of sound does not hide what the probe can do.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation, ProbeSettings
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, as_floats, readonly
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, detect, nominal_bone
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.detection.single.time_of_flight import Fisher, amplitude_bound
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, ProbeSurvey, probe_model

THICKNESS_MM = (3.0, 4.0, 6.0, 8.0, 10.0, 12.0)
LEAST_SNR_DB = 20.0  # of the inner echo behind the matched filter
DEPTHS_MM = np.arange(1.0, 30.1, 0.25)
WRONG_MM = 1.0
STREAM = 0x5EEE

# Settings, thickness in mm, kind of bone, number of A-scans and random numbers; returns the
# A-scans, the true two-way times in the bone (n,) and the places (n, 3).
RecordPlate = Callable[
    [ProbeSettings, float, str, int, np.random.Generator], tuple[AScanTrack, Floats, Floats]
]


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedPerformance:
    """Expected performance of one probe with one excitation at some thicknesses (n,)."""

    probe: str
    excitation: Excitation
    thickness_mm: Floats
    sigma_mm: Floats  # (n,) least standard deviation of the thickness, by noise alone
    snr_db: Floats  # (n,) inner echo behind the matched filter over the noise
    least_mm: float  # depth range
    most_mm: float

    def reaches(self, thickness_mm: float) -> bool:
        """Return whether a thickness lies within the depth range."""
        return self.least_mm <= thickness_mm <= self.most_mm


def expected_performance(
    settings: ProbeSettings, thickness_mm: ArrayLike = THICKNESS_MM
) -> ExpectedPerformance:
    """Return the expected performance of a probe in nominal bone.

    Raises:
        InvalidInputError: thicknesses that are not positive.
    """
    wanted = np.atleast_1d(as_floats(thickness_mm, name="thickness_mm"))
    if not 0.0 < wanted.min() <= wanted.max() <= DEPTHS_MM[-1]:
        raise InvalidInputError(f"thicknesses must be above 0 and at most {DEPTHS_MM[-1]:g} mm")
    probe = probe_model(settings)
    sigma_mm, snr_db = _at(settings, wanted)
    deep = _at(settings, DEPTHS_MM)[1] >= LEAST_SNR_DB
    most = float(DEPTHS_MM[deep][-1]) if deep.any() else 0.0
    return ExpectedPerformance(
        probe=settings.name,
        excitation=settings.excitation,
        thickness_mm=readonly(wanted),
        sigma_mm=readonly(sigma_mm),
        snr_db=readonly(snr_db),
        least_mm=probe.min_thickness_mm,
        most_mm=min(most, probe.max_thickness_mm),
    )


def expected_performances(settings: ProbeSettings) -> tuple[ExpectedPerformance, ...]:
    """Return those of each probe and excitation; what was edited counts for its own probe."""
    kinds: tuple[Excitation, ...] = ("pulse", "chirp")
    unedited = ProbeSettings(
        front_snr_db=settings.front_snr_db, shots=settings.shots, pitch_mm=settings.pitch_mm
    )
    return tuple(
        expected_performance(
            replace(settings if name == settings.name else unedited, name=name, excitation=kind)
        )
        for name in PROBE_DATA
        for kind in kinds
    )


def _at(settings: ProbeSettings, thickness_mm: Floats) -> tuple[Floats, Floats]:
    """Return least sigma in mm and signal over noise in dB at thicknesses (n,)."""
    probe = probe_model(settings)
    template = block_template(probe, settings.excitation)
    band = probe.bandwidth * probe.centre_mhz / (probe.sampling_mhz / 2.0)
    noise = FULL_SCALE_SHARE * 10.0 ** (-settings.averaged_snr_db / 20.0) / np.sqrt(band)
    echoes = bone_filter(template, nominal_bone(), thickness_mm)
    weights = np.full(len(template.frequencies_mhz), 1.0 / (GRID * noise**2))
    fisher = Fisher.of(echoes, weights, template.frequencies_mhz)
    coherent_us = amplitude_bound(fisher, np.ones(len(thickness_mm)))[0]
    snr = np.sqrt(2.0 * np.maximum(fisher.energy, 1e-30))
    return coherent_us * NOMINAL_SPEED_MM_PER_US / 2.0, 20.0 * np.log10(snr)


@dataclass(frozen=True, slots=True)
class WhatIfGrid:
    """What is swept: every probe, excitation, noise and thickness with every other."""

    probes: tuple[str, ...] = tuple(PROBE_DATA)
    excitations: tuple[Excitation, ...] = ("pulse", "chirp")
    snr_db: tuple[float, ...] = (30.0, 50.0)
    thickness_mm: tuple[float, ...] = (3.0, 5.0, 8.0, 11.0)
    kind: str = "normal"  # of the bone, see ``medium.MEDIA``
    n: int = 40  # A-scans in each cell

    @property
    def cells(self) -> tuple[tuple[str, Excitation, float, float], ...]:
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


def sweep(
    grid: WhatIfGrid,
    record: RecordPlate,
    seed: int = 0,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> WhatIf:
    """Return how the recommended detection does in every cell of the grid.

    Args:
        grid: Cells of the sweep.
        record: Makes the A-scans of a plate.
        seed: Of all plates.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between cells.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    cells = grid.cells
    rows: list[tuple[float, ...]] = []
    for number, (name, excitation, snr_db, thickness_mm) in enumerate(cells):
        if cancel():
            raise CancelledError(f"the sweep was cancelled after {number} of {len(cells)} cells")
        settings = ProbeSettings(name=name, excitation=excitation, front_snr_db=snr_db, shots=1)
        random = np.random.default_rng((seed, STREAM, number))
        rows.append(_cell(settings, record(settings, thickness_mm, grid.kind, grid.n, random)))
        progress((number + 1) / len(cells))
    table = np.array(rows).reshape(len(cells), 6)
    return WhatIf(
        probes=tuple(cell[0] for cell in cells),
        excitations=tuple(cell[1] for cell in cells),
        snr_db=readonly(np.array([cell[2] for cell in cells])),
        thickness_mm=readonly(np.array([cell[3] for cell in cells])),
        failures=readonly(table[:, 0].copy()),
        unflagged=readonly(table[:, 1].copy()),
        coverage=readonly(table[:, 2].copy()),
        sd_mm=readonly(table[:, 3].copy()),
        bias_mm=readonly(table[:, 4].copy()),
        n_right=readonly(table[:, 5].astype(np.int64)),
        kind=grid.kind,
        n=grid.n,
    )


def _cell(
    settings: ProbeSettings, recorded: tuple[AScanTrack, Floats, Floats]
) -> tuple[float, ...]:
    """Return failures, unflagged ones, coverage, sd, bias and how many count for these."""
    track, bone_us, places = recorded
    found = detect(
        ProbeSurvey(track, probe_model(settings), settings.excitation, positions_mm=places)
    )
    error = found.thickness_mm - bone_us * found.sound_speed_mm_per_us / 2.0
    wrong, ok = np.abs(error) > WRONG_MM, np.asarray(found.inner_ok)
    right = error[ok & ~wrong]
    enough = len(right) > 1
    return (
        float(wrong.mean()),
        float(wrong[ok].mean()) if ok.any() else 0.0,
        float(ok.mean()),
        float(right.std()) if enough else 0.0,
        float(right.mean()) if enough else 0.0,
        float(len(right)),
    )
