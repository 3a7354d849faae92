"""Detection of the outer and the inner boundary of the bone in a survey of A-scans.

Detection knows what a laboratory knows: the probe, the echo of a reference block, and nominal
sound speeds. It does not know how the echoes were made, and it flags what is not certain.

Loss of the bone, learned from the survey itself: how faint sure inner echoes are, by depth.
Published attenuations of skull bone differ sixfold, so an inner echo cannot be judged by a nominal
one. Sure echoes are as loud as nominal ones but for obliquity, which does not depend on the bone;
what they are fainter by, over the way that they came, is the loss that nominal bone does not have.
A step from table to diploe is fainter for another reason, so only echoes from deeper than any outer
table count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, get_args

import numpy as np
from scipy.special import erf

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.ultrasound.detection.baseline_detectors import find_largest_echoes
from rona_core.ultrasound.detection.single.candidates import (
    Cleared,
    Echoes,
    clear_fronts,
    search_echoes,
)
from rona_core.ultrasound.detection.single.front_echo import fronts_found, standoff_mm
from rona_core.ultrasound.detection.single.inner_echo import InnerEchoes
from rona_core.ultrasound.detection.single.matched_filter import BONE_REFLECTION
from rona_core.ultrasound.detection.single.time_of_flight import Fisher, amplitude_bound
from rona_core.ultrasound.detection.spatial.candidate_selection import select_inner_echoes
from rona_core.ultrasound.detection.spatial.detectability import (
    STEP_SHARE,
    possible_steps,
    within_table,
)
from rona_core.ultrasound.detection.spatial.neighbours import Links, scan_links
from rona_core.ultrasound.detection.spatial.oblique_correction import correct_oblique_echoes
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import DIPLOE, TABLE, Material
from rona_core.ultrasound.probe.probe_model import ProbeSurvey

FIRST_LOSSES = 1.4, 1.8  # over the nominal one: high, so that faint echoes count at first
LOSSES = 0.5, 2.0  # of bone, over the nominal one
LEAST_SURE = 10  # A-scans; fewer tell nothing
USUAL_LEVEL = 0.60  # of a sure inner echo over that of a parallel boundary: it leans, and is rough
SAME_US = 0.2  # the peak that was selected lies this close to the time that was found


def learned_loss(
    echoes: Echoes, inner: InnerEchoes, sure: Bools, bone: Material, loss: float
) -> float | None:
    """Return the attenuation of the bone over the nominal one; None where too few echoes are sure.

    Args:
        echoes: Of all A-scans (n), their levels over those in bone of ``loss``.
        inner: The inner echoes that were selected.
        sure: Which of them count (n,).
        bone: Bone as it was assumed.
        loss: Its attenuation over the nominal one.
    """
    candidates, rows = echoes.candidates, np.arange(len(sure))
    apart = np.where(candidates.exists, np.abs(candidates.lag_us - inner.lag_us[:, None]), np.inf)
    nearest = apart.argmin(axis=1)
    depth_mm = inner.lag_us * bone.speed_mm_per_us / 2.0
    deep = within_table(depth_mm, echoes.template.probe) < STEP_SHARE
    used = sure & deep & (apart[rows, nearest] < SAME_US)
    if np.count_nonzero(used) < LEAST_SURE:
        return None
    level: Floats = candidates.level[rows, nearest][used]
    depth_mm = depth_mm[used]
    centre_mhz = np.array([echoes.template.probe.centre_mhz])
    per_mm = -2.0 * float(bone.wavenumber_per_mm(centre_mhz).imag[0]) / loss  # there and back
    found = loss - np.log(np.maximum(level, 1e-6) / USUAL_LEVEL) / (per_mm * depth_mm)
    return float(np.clip(np.median(found), *LOSSES))


Method = Literal["subtract", "matched", "threshold"]
DIPLOE_SHARE = 0.45  # of the thickness of a skull: 0.40 to 0.55 in the literature
NOMINAL_SPEED_MM_PER_US = 1.0 / (
    (1.0 - DIPLOE_SHARE) / TABLE.speed_mm_per_us + DIPLOE_SHARE / DIPLOE.speed_mm_per_us
)
NOMINAL_DENSITY = 1.8
NOMINAL_LOSS_DB_PER_CM = (
    1.0 - DIPLOE_SHARE
) * TABLE.attenuation_db_per_cm + DIPLOE_SHARE * DIPLOE.attenuation_db_per_cm

# the codes of `flag`
OK, NO_FRONT, NO_INNER, CLIPPED, TOO_THIN, TOO_THICK, UNSURE, TILTED = range(8)
REMOVED = 8  # taken away by hand, see `manual_corrections`
FRONT_LEVEL = 0.25  # of perfect contact; below it the probe is tilted too far
SURE = 0.8  # probability from which on an inner boundary counts
LEAST_SURE_SHARE = 0.02  # of the A-scans of a survey, of which at least this share must be sure
MANY = 100  # A-scans that make a survey
DOUBTED = 0.5  # quality of what the step from table to diploe explains as well
SPEEDS_MM_PER_US = (1.5, 4.5)
OUTER_FLOOR_MM = 0.008  # roughness, film and curvature spread the outer boundary by as much
WRONG_MM = 1.0  # an inner boundary further off is wrong; quality is the chance that it is not
CLEARING_SHARE = 0.1  # of the time, for the fronts
SEARCH_SHARE = 0.6  # of the time of a look
LEARNING_SHARE = 0.5  # of the time, for a first look that estimates the loss of the bone


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Boundaries along the probe axis for each A-scan (n,); entries that are not ok are guesses.

    Sigmas hold if the boundary is the right one, and leave out the error of the sound speed.
    """

    outer_us: Floats  # two-way time from the emission to the outer boundary
    inner_us: Floats  # and to the inner boundary
    outer_ok: Bools
    inner_ok: Bools
    outer_quality: Floats  # 0 to 1: front echo over that of perfect contact
    inner_quality: Floats  # 0 to 1: probability that the inner boundary is right to 1 mm
    flag: Ints  # 0 ok, 1 no front, 2 no inner, 3 clipped, 4 thin, 5 thick, 6 unsure, 7 tilted
    standoff_mm: Floats  # face of the uncompressed line to outer boundary; negative if pressed
    thickness_mm: Floats  # along the probe axis
    outer_sigma_mm: Floats
    thickness_sigma_mm: Floats
    inner_sigma_us: Floats  # of the time between the boundaries
    alternative_us: Floats  # the runner-up for ``inner_us``
    alternative_quality: Floats  # and its probability, 0 where there is no other
    probe: str
    excitation: str
    method: str
    sound_speed_mm_per_us: float  # of bone
    # attenuation of the bone over the nominal one; None: taken as nominal, as in older files
    bone_loss: float | None = field(default=None, metadata={"omit_empty": True})

    def __len__(self) -> int:
        return len(self.flag)

    @classmethod
    def joined(cls, parts: Sequence["Detection"]) -> "Detection":
        """Return the A-scans of several detections by the same probe, one after the other."""
        columns = [f.name for f in fields(cls) if isinstance(getattr(parts[0], f.name), np.ndarray)]
        together: dict[str, Any] = {
            name: readonly(np.concatenate([getattr(part, name) for part in parts]))
            for name in columns
        }
        return replace(parts[0], **together)


def detect(
    survey: ProbeSurvey,
    *,
    method: Method = "subtract",
    sound_speed_mm_per_us: float = NOMINAL_SPEED_MM_PER_US,
    bone_loss: float | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Detection:
    """Return the outer and the inner boundary of the bone below the probe in each A-scan.

    Args:
        survey: A-scans, their probe, and where it was.
        method: "subtract" fits and subtracts the front echo and uses the neighbours; "matched"
            takes the largest peak of a matched filter, "threshold" the rising edge in the
            filtered envelope, both A-scan by A-scan.
        sound_speed_mm_per_us: Mean speed in bone; thickness is proportional to it.
        bone_loss: Attenuation of the bone over the nominal one; None: learned from the survey.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between blocks of A-scans.

    Raises:
        InvalidInputError: an unknown method, an impossible speed, or positions of another shape,
            or not finite.
        CancelledError: ``cancel`` said so.
    """
    _check(method, sound_speed_mm_per_us)
    started = CLEARING_SHARE
    cleared = clear_fronts(survey, progress=_part(progress, 0.0, started), cancel=cancel)
    look = _Look(survey, cleared, scan_links(survey.positions_mm, len(survey)), method)
    if bone_loss is None and method == "subtract":
        started = LEARNING_SHARE
        part = _part(progress, CLEARING_SHARE, started)
        bone_loss = _learned(look, sound_speed_mm_per_us, part, cancel)
    bone = nominal_bone(sound_speed_mm_per_us, 1.0 if bone_loss is None else bone_loss)
    found = look.found(bone, _part(progress, started, 1.0), cancel)
    progress(1.0)
    judged = _judged(survey, method, bone, *found)
    if method == "subtract" and not has_inner_echoes(judged):
        judged = doubted(judged, judged.inner_ok)
    return replace(judged, bone_loss=bone_loss)


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """What looks at a survey share, whatever they think of the bone."""

    survey: ProbeSurvey
    cleared: Cleared
    links: Links
    method: Method

    def found(
        self, bone: Material, progress: Progress, cancel: Cancel
    ) -> tuple[Echoes, InnerEchoes]:
        """Return the echoes in bone that is thought to be like this, and the inner ones."""
        part = _part(progress, 0.0, SEARCH_SHARE)
        echoes = search_echoes(self.cleared, bone, progress=part, cancel=cancel)
        if self.method != "subtract":
            return echoes, find_largest_echoes(echoes, bone, self.method)
        inner = select_inner_echoes(echoes, bone, self.links)
        return echoes, correct_oblique_echoes(echoes, inner, bone, self.survey, self.links)


def _learned(
    look: _Look, sound_speed_mm_per_us: float, progress: Progress, cancel: Cancel
) -> float | None:
    """Return the attenuation of the bone over the nominal one; None where no echo shows it."""
    for i, loss in enumerate(FIRST_LOSSES):
        bone = nominal_bone(sound_speed_mm_per_us, loss)
        part = _part(progress, i / len(FIRST_LOSSES), (i + 1) / len(FIRST_LOSSES))
        found = look.found(bone, part, cancel)
        sure = _judged(look.survey, look.method, bone, *found).inner_ok
        learned = learned_loss(*found, sure, bone, loss)
        if learned is not None:
            return learned
    return None


def has_inner_echoes(found: Detection) -> bool:
    """Return whether a survey has inner echoes at all, beyond those that are sure by chance."""
    return len(found) < MANY or bool(found.inner_ok.mean() >= LEAST_SURE_SHARE)


def doubted(found: Detection, which: Bools) -> Detection:
    """Return a detection that is not sure of the inner boundary of some A-scans (n,)."""
    which = which & found.inner_ok
    return replace(
        found,
        inner_ok=readonly(found.inner_ok & ~which),
        inner_quality=readonly(np.minimum(found.inner_quality, np.where(which, DOUBTED, 1.0))),
        flag=readonly(np.where(which, UNSURE, found.flag)),
    )


def _part(progress: Progress, start: float, end: float) -> Progress:
    """Return a progress that reports a part as a share of the whole."""
    return lambda share: progress(start + (end - start) * share)


def nominal_bone(
    sound_speed_mm_per_us: float = NOMINAL_SPEED_MM_PER_US, loss: float = 1.0
) -> Material:
    """Return bone as detection thinks of it: one layer, ``loss`` times as lossy as on the mean."""
    return Material(sound_speed_mm_per_us, NOMINAL_DENSITY, loss * NOMINAL_LOSS_DB_PER_CM)


def _check(method: str, speed_mm_per_us: float) -> None:
    low, high = SPEEDS_MM_PER_US
    if method not in get_args(Method):
        raise InvalidInputError(f"method must be one of {', '.join(get_args(Method))}: {method!r}")
    if not low <= speed_mm_per_us <= high:
        raise InvalidInputError(f"the speed in bone must be {low} to {high}: {speed_mm_per_us}")


def _judged(
    survey: ProbeSurvey, method: Method, bone: Material, echoes: Echoes, inner: InnerEchoes
) -> Detection:
    probe = survey.probe
    front, half_speed = echoes.fronts, bone.speed_mm_per_us / 2.0
    thickness, sigma = inner.lag_us * half_speed, inner.sigma_us * half_speed
    no_front = ~fronts_found(front, probe)
    if method == "subtract":
        quality = inner.confidence * erf(WRONG_MM / np.maximum(sigma, 1e-9) / np.sqrt(2.0))
        unsure = quality < SURE
        cycle_mm = half_speed / probe.centre_mhz
        sigma = np.hypot(sigma, np.sqrt(np.maximum(inner.slip_chance, 0.0)) * cycle_mm)
    else:
        quality, unsure = np.clip(inner.confidence, 0.0, 1.0), np.zeros(len(sigma), dtype=np.bool_)
    clipped = np.asarray(survey.track.clipped)
    flag = np.select(
        [
            no_front,
            clipped,
            front.level < FRONT_LEVEL,
            ~inner.detected,
            thickness < probe.min_thickness_mm,
            thickness > probe.max_thickness_mm,
            unsure,
        ],
        [NO_FRONT, CLIPPED, TILTED, NO_INNER, TOO_THIN, TOO_THICK, UNSURE],
        OK,
    ).astype(np.int64)
    if method == "subtract":
        steps = possible_steps(thickness, flag == OK, probe)
        flag, quality = np.where(steps, UNSURE, flag), np.where(steps, DOUBTED, quality)
    outer_us = probe.line_delay_us + front.delay_us
    return Detection(
        outer_us=readonly(outer_us),
        inner_us=readonly(outer_us + inner.lag_us),
        outer_ok=readonly(~(no_front | clipped)),
        inner_ok=readonly(flag == OK),
        outer_quality=readonly(np.where(no_front, 0.0, np.clip(front.level, 0.0, 1.0))),
        inner_quality=readonly(np.where(no_front | ~inner.detected, 0.0, quality)),
        flag=readonly(flag),
        standoff_mm=readonly(standoff_mm(front.delay_us, probe)),
        thickness_mm=readonly(thickness),
        outer_sigma_mm=readonly(_outer_sigma_mm(echoes)),
        thickness_sigma_mm=readonly(sigma),
        inner_sigma_us=readonly(sigma / half_speed),
        alternative_us=readonly(outer_us + inner.alternative_us),
        alternative_quality=readonly(np.where(no_front, 0.0, inner.alternative_confidence)),
        probe=probe.name,
        excitation=survey.excitation,
        method=method,
        sound_speed_mm_per_us=bone.speed_mm_per_us,
    )


def _outer_sigma_mm(echoes: Echoes) -> Floats:
    """Return the sigma (n,) of the outer boundary: the bound of its time, and structure."""
    template, n = echoes.template, len(echoes.noise)
    weights = 1.0 / (GRID * np.maximum(echoes.noise, 1e-9)[:, None] ** 2)
    echo = np.broadcast_to(BONE_REFLECTION * template.spectrum, (n, len(template.spectrum)))
    fisher = Fisher.of(echo, weights, template.frequencies_mhz)
    noise_us = amplitude_bound(fisher, echoes.fronts.level)[0]
    return np.hypot(noise_us * template.probe.line.speed_mm_per_us / 2.0, OUTER_FLOOR_MM)
