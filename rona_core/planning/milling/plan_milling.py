"""Milling path of a bed: concentric layers from the top, then a rim pass with a smaller burr.

At the end of every layer the bed is a valid, shallower one: nothing is cut beyond the planned bed,
and the floor of the layer is flat but for the ridges between rings. See
docs/algorithms/implant/milling.md.

Tilt of a ball burr: its pole, which does not move, is kept behind the feed. The front of a ball
that moves along v is where its normals n have n . v > 0. The pole lies at the end of the axis a, so
that it is behind as long as a . v < 0: with the axis leant against the feed by t, and a way down of
slope s, a . v = sin(s - t).
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
import shapely
from shapely.geometry import LineString, Point

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.planning.implants.implant import Implant
from rona_core.planning.milling.burr import BALL_2, Burr, MillingSettings, ball
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.milling.tool_regions import CHORD_MM, Level, levels, strokes

BURRS_MM = (5.0, 4.0, 3.0, 2.0)  # balls, the largest that goes into the bed is taken


def milling_settings(implant: Implant, burr_mm: float | None) -> MillingSettings:
    """Return how a bed is milled: with a ball of this diameter, else the largest that goes in.

    Raises:
        InvalidInputError: no burr goes into the bed.
    """
    *larger, last = BURRS_MM if burr_mm is None else (burr_mm,)
    for size_mm in larger:
        try:
            return _settings(implant, size_mm)
        except InvalidInputError:
            continue  # a smaller one may go in
    return _settings(implant, last)


def _settings(implant: Implant, burr_mm: float) -> MillingSettings:
    """Return how a bed is milled with a ball; raise InvalidInputError where it does not go in."""
    settings = MillingSettings(
        burr=ball(burr_mm),
        rim_burr=BALL_2 if burr_mm > BALL_2.diameter_mm else None,
        layer_mm=min(0.5, 0.25 * burr_mm),
    )
    planned_bed(implant, settings, cell_mm=1.0)
    return settings


CORNER_RAD = float(np.deg2rad(30.0))  # of the path: where it turns by more, the axis turns in place


def tilted(bottoms_bed: Floats, moves: Ints, tilt_rad: float) -> tuple[Floats, Floats, Ints]:
    """Return lowest places (m, 3), axes (m, 3) into the bone and moves (m,) with m >= n.

    At corners of the path a place stands twice, with the axis of the way in and of the way out.
    """
    steps = np.diff(bottoms_bed, axis=0)
    moved = np.concatenate(([True], np.linalg.norm(steps, axis=1) > 1e-9))
    bottoms, moves = bottoms_bed[moved], moves[moved]
    n = len(bottoms)
    if tilt_rad == 0.0 or n < 2:
        return bottoms, np.tile((0.0, 0.0, -1.0), (n, 1)), moves
    along = np.diff(bottoms[:, :2], axis=0)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    into = np.concatenate((heading[:1], heading))
    out = np.concatenate((heading, heading[-1:]))
    corner = np.abs(out - into) > CORNER_RAD
    times = np.where(corner, 2, 1)
    rows = np.repeat(np.arange(n), times)
    second = np.concatenate(([False], rows[1:] == rows[:-1]))
    heading = np.where(
        corner[rows], np.where(second, out[rows], into[rows]), 0.5 * (into + out)[rows]
    )
    sine, cosine = np.sin(tilt_rad), np.cos(tilt_rad)
    axes = np.column_stack(
        (-sine * np.cos(heading), -sine * np.sin(heading), np.full(len(rows), -cosine))
    )
    return bottoms[rows], axes, moves[rows]


CLEAR_MM = 0.05  # above the ridges of the layer above, where the way down into the next begins


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Lowest places of the burr (n, 3) from one way down to the next way up, and their moves."""

    bottoms_bed: Floats
    moves: Ints  # (n,) of the moves that end there


def plan_milling(
    implant: Implant, settings: MillingSettings | None = None, surface_mm: float = 0.0
) -> MillingPath:
    """Return the path that mills the bed of an implant.

    Args:
        implant: With its lift.
        settings: Burrs, layers, allowances, tilt and entry.
        surface_mm: How far the bone within the outline rises above z = 0: layers begin there.

    Raises:
        InvalidInputError: a burr larger than the bed, or a surface outside 0 to 10 mm.
    """
    settings = settings or MillingSettings()
    high_mm = surface_mm + settings.retract_mm
    parts: list[tuple[Floats, Floats, Ints, int, int]] = []
    for number, level in enumerate(levels(implant, settings, surface_mm)):
        burr = settings.burrs[level.burr]
        for run in _runs(level, burr, settings):
            tilt_rad = settings.tilt_rad if burr.is_ball else 0.0
            bottoms, axes, moves = tilted(run.bottoms_bed, run.moves, tilt_rad)
            tips = bottoms + burr.radius_mm * (axes + (0.0, 0.0, 1.0))
            rise = np.array((0.0, 0.0, high_mm))
            up = [end + rise - (0.0, 0.0, bottom[2]) for end, bottom in _ends(tips, bottoms)]
            aside = np.array([int(Move.RETRACT)])
            parts.append(
                (
                    np.vstack((up[0], tips, up[1])),
                    np.vstack((axes[:1], axes, axes[-1:])),
                    np.concatenate((aside, aside, moves[1:], aside)),
                    number,
                    level.burr,
                )
            )
    sizes = [len(part[0]) for part in parts]
    return MillingPath(
        np.vstack([part[0] for part in parts]),
        np.vstack([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]),
        np.repeat([part[3] for part in parts], sizes),
        np.repeat([part[4] for part in parts], sizes),
        settings.burrs,
    )


def _ends(tips: Floats, bottoms: Floats) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    return (tips[0], bottoms[0]), (tips[-1], bottoms[-1])


def _runs(level: Level, burr: Burr, settings: MillingSettings) -> list[Run]:
    """Return the runs of one layer: rings linked where the way between them lies in the bed."""
    cut = Move.CUT if level.wanted is None else Move.RIM
    ridge_mm = max(b.scallop_mm(settings.pitch * b.radius_mm) for b in settings.burrs)
    start_mm = level.above_mm - ridge_mm - CLEAR_MM
    slope = float(np.tan(np.deg2rad(settings.ramp_deg)))
    room = level.region.buffer(2.0 * CHORD_MM)
    shapely.prepare(room)
    runs: list[tuple[list[Floats], list[Ints]]] = []
    for line in strokes(level, burr, settings.pitch * burr.radius_mm):
        closed = bool((line[0] == line[-1]).all())
        if runs:
            here = runs[-1][0][-1][-1]
            line = _from_nearest(line, here[:2], closed)
            if room.covers(LineString((here[:2], line[0]))):
                runs[-1][0].append(_at_depth(line, level.depth_mm))
                runs[-1][1].append(np.full(len(line), int(cut)))
                continue
        ramp = _ramp(line, (level.depth_mm - start_mm) / slope, closed)
        way = np.concatenate(([0.0], np.cumsum(_steps(ramp))))
        down = np.column_stack((ramp, -start_mm - way * slope))
        rest = _after_ramp(line, ramp[-1], closed)
        runs.append(
            (
                [down, _at_depth(rest, level.depth_mm)],
                [np.full(len(down), int(Move.ENTRY)), np.full(len(rest), int(cut))],
            )
        )
    return [Run(np.vstack(places), np.concatenate(moves)) for places, moves in runs]


def _ramp(line: Floats, length_mm: float, closed: bool) -> Floats:
    """Return the way (n, 2) of so many millimetres round a ring, or to and fro along a line."""
    once = line if closed else np.vstack((line, line[-2::-1]))
    rounds = int(np.ceil(length_mm / float(_steps(once).sum()) + 1e-9))
    whole = np.vstack((once, *([once[1:]] * (rounds - 1))))
    way = np.concatenate(([0.0], np.cumsum(_steps(whole))))
    last = int(np.searchsorted(way, length_mm))
    share = (length_mm - way[last - 1]) / (way[last] - way[last - 1])
    end = whole[last - 1] + share * (whole[last] - whole[last - 1])
    return np.vstack((whole[:last], end))


def _after_ramp(line: Floats, end: Floats, closed: bool) -> Floats:
    """Return the whole of a line (n, 2) from where the ramp onto it ended."""
    along = LineString(line)
    place = along.project(Point(end))
    way = np.concatenate(([0.0], np.cumsum(_steps(line))))
    before, after = line[way < place - 1e-9], line[way > place + 1e-9]
    if closed:
        return np.vstack((end, after, before[1:], end))
    return np.vstack((end, after, line[::-1]))


def _from_nearest(line: Floats, place: Floats, closed: bool) -> Floats:
    """Return a line (n, 2) from its corner next to a place, or from its nearer end."""
    away = np.linalg.norm(line - place, axis=1)
    if closed:
        first = int(np.argmin(away[:-1]))
        return np.vstack((line[first:-1], line[: first + 1]))
    return line if away[0] <= away[-1] else line[::-1]


def _steps(line: Floats) -> Floats:
    return cast(Floats, np.linalg.norm(np.diff(line, axis=0), axis=1))


def _at_depth(line: Floats, depth_mm: float) -> Floats:
    return np.column_stack((line, np.full(len(line), -depth_mm)))
