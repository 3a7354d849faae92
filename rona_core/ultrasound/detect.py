"""Find the outer and the inner boundary of the bone in a survey of A-scans.

Detection knows what a laboratory knows: the probe, the echo of a reference block, and nominal
sound speeds. It does not know how the echoes were made, and it flags what it is not sure of.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rona_core.arrays import Bools, Floats, Ints, readonly
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.ultrasound.chain import choose_inner
from rona_core.ultrasound.front import (
    Fronts,
    find_fronts,
    fronts_at,
    gate_us,
    standoff_mm,
    subtract_fronts,
)
from rona_core.ultrasound.inner import Candidates, InnerChoice, bone_gate_us, find_candidates
from rona_core.ultrasound.matched import block_template, trace_spectra
from rona_core.ultrasound.material import DIPLOE, TABLE, Material
from rona_core.ultrasound.plain import find_plain_inner
from rona_core.ultrasound.probe import ProbeModel

Method = Literal["subtract", "matched", "threshold"]
DIPLOE_SHARE = 0.45  # of the thickness of a skull: 0.40 to 0.55 in the literature
NOMINAL_SPEED_MM_PER_US = 1.0 / (
    (1.0 - DIPLOE_SHARE) / TABLE.speed_mm_per_us + DIPLOE_SHARE / DIPLOE.speed_mm_per_us
)
NOMINAL_DENSITY = 1.8
NOMINAL_LOSS_DB_PER_CM = (
    1.0 - DIPLOE_SHARE
) * TABLE.attenuation_db_per_cm + DIPLOE_SHARE * DIPLOE.attenuation_db_per_cm

OK, NO_FRONT, NO_INNER, CLIPPED, TOO_THIN, TOO_THICK, UNSURE = range(7)  # the codes of `flag`
FRONT_SNR = 8.0  # below it there is no front echo
FRONT_LEVEL = 0.25  # of perfect contact; below it the probe is tilted too far
SURE = 0.8  # probability from which on an inner boundary counts
BLOCK = 256  # A-scans at a time
SPEEDS_MM_PER_US = (1.5, 4.5)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Boundaries along the probe axis for each A-scan (n,); entries that are not ok are guesses."""

    outer_us: Floats  # two-way time from the emission to the outer boundary
    inner_us: Floats  # and to the inner boundary
    outer_ok: Bools
    inner_ok: Bools
    outer_quality: Floats  # 0 to 1: front echo over that of perfect contact
    inner_quality: Floats  # 0 to 1: probability that this is the inner boundary
    flag: Ints  # 0 ok, 1 no front, 2 no inner, 3 clipped, 4 too thin, 5 too thick, 6 unsure
    standoff_mm: Floats  # face of the uncompressed line to outer boundary; negative if pressed
    thickness_mm: Floats  # along the probe axis
    probe: str
    excitation: str
    method: str
    sound_speed_mm_per_us: float  # of bone

    def __len__(self) -> int:
        return len(self.flag)


def detect(
    track: AScanTrack,
    probe: ProbeModel,
    excitation: Excitation,
    *,
    method: Method = "subtract",
    sound_speed_mm_per_us: float = NOMINAL_SPEED_MM_PER_US,
    known_standoff_mm: Floats | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Detection:
    """Return where the bone begins and ends below the probe, A-scan by A-scan.

    Args:
        track: A-scans in the order of the path; neighbours support each other ("subtract" only).
        probe: The probe that took them.
        excitation: What it sent.
        method: "subtract" fits and subtracts the front echo; "matched" takes the largest peak
            of a matched filter, "threshold" the rising edge in the filtered envelope.
        sound_speed_mm_per_us: Mean speed in bone; thickness is proportional to it.
        known_standoff_mm: Where the outer boundary is (n,), along the axis from the face of the
            uncompressed line, if that is known better than from these A-scans: a probe that leans
            towards the inner table hardly hears it. None: found in each A-scan.
        progress: Told the share that is done.
        cancel: Asked between blocks of A-scans.

    Raises:
        InvalidInputError: an unknown method, an impossible speed, or another sampling rate.
        CancelledError: ``cancel`` said so.
    """
    _check(track, probe, method, sound_speed_mm_per_us)
    template = block_template(probe, excitation)
    bone = nominal_bone(sound_speed_mm_per_us)
    fronts: list[Fronts] = []
    candidates: list[Candidates] = []
    choices: list[InnerChoice] = []
    for start in range(0, len(track), BLOCK):
        if cancel():
            raise CancelledError("the detection of echoes was cancelled")
        rf = track.rf[start : start + BLOCK].astype(np.float64)
        spectra, noise = trace_spectra(rf, track.start_us, template)
        front = find_fronts(spectra, noise, template)
        if known_standoff_mm is not None:
            front = fronts_at(known_standoff_mm[start : start + BLOCK], probe)
        aligned = spectra * template.shift(probe.line_delay_us + front.delay_us)
        fronts.append(front)
        if method == "subtract":
            behind = subtract_fronts(aligned, template)
            candidates.append(find_candidates(behind, noise, template, bone))
        else:
            gate = bone_gate_us(probe, bone)
            choices.append(find_plain_inner(aligned, noise, template, method, gate))
        progress(min(1.0, (start + BLOCK) / max(len(track), 1)))
    if method == "subtract":
        choices = [choose_inner(Candidates.concatenate(candidates), bone, probe.centre_mhz)]
    inner = InnerChoice.concatenate(choices)
    return _judge(track, probe, excitation, method, bone, Fronts.concatenate(fronts), inner)


def nominal_bone(sound_speed_mm_per_us: float = NOMINAL_SPEED_MM_PER_US) -> Material:
    """Return bone as detection thinks of it: one layer, of mean speed and loss."""
    return Material(sound_speed_mm_per_us, NOMINAL_DENSITY, NOMINAL_LOSS_DB_PER_CM)


def _check(track: AScanTrack, probe: ProbeModel, method: str, speed_mm_per_us: float) -> None:
    low, high = SPEEDS_MM_PER_US
    if method not in get_args(Method):
        raise InvalidInputError(f"method must be one of {', '.join(get_args(Method))}: {method!r}")
    if not low <= speed_mm_per_us <= high:
        raise InvalidInputError(f"the speed in bone must be {low} to {high}: {speed_mm_per_us}")
    if len(track) and track.sampling_mhz != probe.sampling_mhz:
        raise InvalidInputError(
            f"the {probe.name} probe samples at {probe.sampling_mhz} MHz, "
            f"these A-scans were sampled at {track.sampling_mhz} MHz"
        )


def _judge(
    track: AScanTrack,
    probe: ProbeModel,
    excitation: Excitation,
    method: Method,
    bone: Material,
    front: Fronts,
    inner: InnerChoice,
) -> Detection:
    thickness = inner.lag_us * bone.speed_mm_per_us / 2.0
    early, late = gate_us(probe)
    edge = (front.delay_us < early + 0.1) | (front.delay_us > late - 0.1)
    no_front = (front.snr < FRONT_SNR) | ~front.positive | edge
    tilted = front.level < FRONT_LEVEL
    unsure = tilted | (inner.sureness < SURE) if method == "subtract" else tilted
    flag = np.select(
        [
            no_front,
            np.asarray(track.clipped),
            ~inner.heard,
            thickness < probe.min_thickness_mm,
            thickness > probe.max_thickness_mm,
            unsure,
        ],
        [NO_FRONT, CLIPPED, NO_INNER, TOO_THIN, TOO_THICK, UNSURE],
        OK,
    ).astype(np.int64)
    outer_us = probe.line_delay_us + front.delay_us
    return Detection(
        outer_us=readonly(outer_us),
        inner_us=readonly(outer_us + inner.lag_us),
        outer_ok=readonly(~(no_front | np.asarray(track.clipped))),
        inner_ok=readonly(flag == OK),
        outer_quality=readonly(np.where(no_front, 0.0, np.clip(front.level, 0.0, 1.0))),
        inner_quality=readonly(
            np.where(no_front | ~inner.heard, 0.0, np.clip(inner.sureness, 0.0, 1.0))
        ),
        flag=readonly(flag),
        standoff_mm=readonly(standoff_mm(front.delay_us, probe)),
        thickness_mm=readonly(thickness),
        probe=probe.name,
        excitation=excitation,
        method=method,
        sound_speed_mm_per_us=bone.speed_mm_per_us,
    )
