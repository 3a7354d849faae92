"""Where along the path the probe may lean too far, and where the pointer should pass once more."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.dependencies.judge import fresh
from rona_core.app.messages.message import Point
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.surface.normals.normals import REASONS, thin_places
from rona_core.path.coverage import covered_share
from rona_core.session.document import Session
from rona_core.session.memo import Memo
from rona_core.ultrasound.probe.beam import half_echo_tilt_deg
from rona_core.ultrasound.probe.probe_model import probe_model

UNSURE = "the normal is uncertain by {worst:.1f}°"
BENT = "no normal is known where the bone turns: up to {worst:.1f}°; take normals closer"
SAME_MM = 6.0  # places closer along the path are one entry


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of the path with one remark on it."""

    from_mm: float  # along the way-points
    to_mm: float
    sentence: str
    times: float = 1.0  # how many times as many surface points would do


@dataclass(frozen=True, slots=True, eq=False)
class PathCheck:
    """The normals along the path, judged for the probe that is chosen."""

    places_base: Floats  # (m, 3) where the normals are
    normals: Floats  # (m, 3) out of the bone
    sigma_deg: Floats  # (m,) predicted error
    tolerance_deg: float  # tilt at which half of the echo is lost
    tilted: Bools  # (m,) may exceed it
    warnings: tuple[Stretch, ...]
    thin: Bools  # (m,) another pass of the pointer would help
    proposals: tuple[Stretch, ...]


_COVERED: Memo[float | None] = Memo(8)  # every picture asks


def _covered(path_base: Floats, surface_base: Floats, radius_mm: float) -> float | None:
    try:
        return covered_share(path_base, surface_base, radius_mm)
    except DegenerateGeometryError:
        return None


def expected_coverage(
    session: Session, picks_base_mm: tuple[Point, ...] | None = None
) -> float | None:
    """Return which share of the region the scan would cover, 0 to 1; None where it is unknown.

    That is before the surface is measured, and where regions to scan are painted.

    Args:
        session: With the measured surface.
        picks_base_mm: Places of a path that is being drawn, in place of the recorded one.
    """
    cloud, path = fresh("surface", session), fresh("path", session)
    if cloud is None or session.painted.of("scan"):
        return None
    if picks_base_mm is not None:
        places = readonly(np.array(picks_base_mm, dtype=np.float64).reshape(-1, 3))
    elif path is not None:
        places = path.points_base
    else:
        return None
    if not len(places):
        return None
    values, radius_mm = (places, cloud.points_base), session.setup.region.radius_mm
    return _COVERED.get(values, lambda: _covered(*values, radius_mm), radius_mm)


def check_path(session: Session) -> PathCheck | None:
    """Return what is to be said about the normals of the smoothed path; None before there is one.

    The probe may lean by the predicted error of the normal (one sigma), and between two normals by
    half the angle from one to the other. Either is compared with the tilt that costs half of the
    echo.
    """
    smooth = session.results.smoothing
    if smooth is None:
        return None
    value = smooth.value
    places = value.corners_base if value.way_points_base is None else value.way_points_base
    normals, probe = value.normals, probe_model(session.setup.devices.probe)
    limit = half_echo_tilt_deg(probe)
    bend = half_turns_deg(normals.normals)
    unsure, bent = normals.sigma_deg > limit, bend > limit
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))))
    onward = np.append(along[1:], along[-1:])  # it is between a place and the next one
    found = thin_places(normals, places, max_sigma_deg=0.5 * limit)
    thin = np.zeros(len(places), dtype=np.bool_)
    thin[found.places] = True
    proposals: list[Stretch] = []
    for reason in dict.fromkeys(found.reasons):
        at = np.array([p for p, r in zip(found.places, found.reasons, strict=True) if r == reason])
        proposals += _stretches(along, at, found.times, found.places, reason)
    return PathCheck(
        places_base=places,
        normals=normals.normals,
        sigma_deg=normals.sigma_deg,
        tolerance_deg=limit,
        tilted=readonly(unsure | bent),
        warnings=tuple(
            sorted(
                (
                    *_exceeding(along, along, unsure, normals.sigma_deg, UNSURE),
                    *_exceeding(along, onward, bent, bend, BENT),
                ),
                key=lambda stretch: stretch.from_mm,
            )
        ),
        thin=readonly(thin),
        proposals=tuple(sorted(proposals, key=lambda stretch: stretch.from_mm)),
    )


def half_turns_deg(normals: Floats) -> Floats:
    """Return half the angle (m,) from each normal to the next; 0 at the last.

    Halfway between them the axis is made up, and may be wrong by so much.
    """
    steps = np.linalg.norm(np.diff(normals, axis=0), axis=1)
    turns = np.rad2deg(2.0 * np.arcsin(np.clip(0.5 * steps, 0.0, 1.0)))
    return np.append(0.5 * turns, 0.0)


def _exceeding(
    along: Floats, until: Floats, where: Bools, values: Floats, words: str
) -> list[Stretch]:
    return [
        Stretch(float(along[a]), float(until[b]), words.format(worst=values[a : b + 1].max()))
        for a, b in _runs(along, np.flatnonzero(where))
    ]


def _stretches(along: Floats, at: Ints, times: Floats, places: Ints, reason: str) -> list[Stretch]:
    factor = dict(zip(places.tolist(), times.tolist(), strict=True))
    at = np.sort(at)
    made = []
    for a, b in _runs(along, at):
        more = max(factor[int(i)] for i in at if a <= i <= b)
        made.append(Stretch(float(along[a]), float(along[b]), REASONS[reason], float(more)))
    return made


def _runs(along: Floats, at: Ints) -> list[tuple[int, int]]:
    """Return first and last of each run of places that lie close together."""
    runs: list[tuple[int, int]] = []
    for i in (int(place) for place in at):
        if runs and along[i] - along[runs[-1][1]] <= SAME_MM:
            runs[-1] = runs[-1][0], i
        else:
            runs.append((i, i))
    return runs
