"""Sampling of a simulated head from a seed: size, thickness, bumps, grooves and sutures.

Levels and patterns follow measured heads (docs/algorithms/virtual_world/simulated_skull.md). Depths
of diploe, grooves and sutures are plausible values: no source for them was found.
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.virtual.specimen.boundaries import SMOOTH, Relief
from rona_core.virtual.specimen.simulated.layer_radii import SkullShape
from rona_core.virtual.specimen.simulated.spherical_fields import (
    CENTER_SKULL,
    HEAD_MM,
    Bumps,
    Curves,
    Egg,
    Place,
    Waves,
    direction_of,
    tangents,
    trace_curve,
)

STREAM = 0x5C011  # keeps the draws of the skull apart from other uses of the same seed

# place, widths along and across the head in mm, height in mm
Bump = tuple[Place, tuple[float, float], float]
OUTER_BUMPS: tuple[Bump, ...] = (
    ((-28.0, 22.0), (24.0, 20.0), -3.5),  # temporal fossa
    ((38.0, 74.0), (24.0, 20.0), 2.2),  # parietal eminence
    ((16.0, -14.0), (9.0, 10.0), 7.0),  # mastoid
    ((0.0, 6.0), (24.0, 4.0), 1.6),  # supramastoid crest
)
OUTER_MIDLINE: tuple[Bump, ...] = (
    ((92.0, 12.0), (9.0, 9.0), 3.0),  # external occipital protuberance
    ((-88.0, 62.0), (30.0, 30.0), 2.0),  # frontal bossing
)
THICKNESS_BUMPS: tuple[Bump, ...] = (
    ((-12.0, 28.0), (24.0, 19.0), -2.2),  # temporal squama
    ((-42.0, 26.0), (14.0, 14.0), -0.8),  # pterion
    ((78.0, 34.0), (24.0, 32.0), 1.6),  # posterior parietal and occipital
    ((18.0, -13.0), (13.0, 10.0), 10.0),  # mastoid
    ((40.0, -2.0), (17.0, 9.0), 3.5),  # towards the asterion
    ((2.0, 6.0), (22.0, 5.0), 1.4),  # supramastoid crest
)
THICKNESS_MIDLINE: tuple[Bump, ...] = (((-85.0, 62.0), (34.0, 34.0), 1.2),)  # frontal bone

# waypoints and depth in mm
Groove = tuple[tuple[Place, ...], float]
MENINGEAL_GROOVES: tuple[Groove, ...] = (
    (((-32.0, 16.0), (-32.0, 40.0), (-22.0, 66.0), (-8.0, 90.0)), 0.9),
    (((-28.0, 16.0), (-5.0, 30.0), (16.0, 43.0), (36.0, 57.0), (52.0, 76.0)), 0.8),
    (((16.0, 43.0), (32.0, 38.0), (52.0, 42.0)), 0.6),
    (((-5.0, 30.0), (4.0, 54.0), (16.0, 82.0)), 0.6),
)
SINUS: Groove = (((74.0, 12.0), (48.0, 12.0), (28.0, 7.0), (19.0, -8.0), (16.0, -24.0)), 3.2)
TEMPORAL_LINE: Groove = (((-42.0, 38.0), (-18.0, 68.0), (20.0, 76.0), (48.0, 58.0)), 0.4)
GROOVE_MM, SINUS_MM, LINE_MM, SUTURE_MM = 0.9, 4.2, 3.0, 0.6  # standard deviations across

BREGMA, LAMBDA = (-14.0, 121.0), (84.0, 78.0)
PTERION, ASTERION = (-40.0, 22.0), (47.0, 6.0)
SQUAMOSAL = (PTERION, (-22.0, 44.0), (4.0, 47.0), (26.0, 24.0), (34.0, 8.0), ASTERION)
CORONAL = ((-26.0, 92.0), (-36.0, 58.0), PTERION)  # from bregma down
LAMBDOID = ((74.0, 52.0), (60.0, 26.0), ASTERION)  # from lambda down
ZIGZAG_MM = 1.3

RELIEF_LENGTHS_MM, RELIEF_SDS_MM = np.array((45.0, 19.0, 7.5)), np.array((0.8, 0.25, 0.03))
THICKNESS_LENGTHS_MM, THICKNESS_SDS_MM = np.array((45.0, 19.0, 7.5)), np.array((0.4, 0.8, 0.56))
# correlation length of small unevenness: 1.7 mm on a skull of 0.5 mm voxels, 3 mm as beams see it
TEXTURE_MM, RELIEF_WAVES = 3.0, 200
INNER_STREAM, STEP_STREAM = 1, 2  # of the relief of these boundaries, beside the rest of a head
MEAN_THICKNESS_MM, SD_THICKNESS_MM, SPREAD = 5.95, 0.95, 1.8  # of the base; spread in SD


def draw_patient(seed: int, relief: Relief = SMOOTH) -> SkullShape:
    """Return the head of a seed; both of its sides differ."""
    rng = np.random.default_rng((STREAM, seed))
    scale = np.clip(rng.normal(1.0, 0.025, 4), 0.94, 1.06)
    width, length, height = np.array((70.0, 92.0, 75.0)) * scale[0] * scale[1:] ** 0.6
    egg = Egg((float(width), float(length), float(height)))
    base = MEAN_THICKNESS_MM + SD_THICKNESS_MM * np.clip(rng.normal(), -SPREAD, SPREAD)
    bumps = _bumps(rng, egg, OUTER_BUMPS, OUTER_MIDLINE)
    template = _bumps(rng, egg, THICKNESS_BUMPS, THICKNESS_MIDLINE)
    return SkullShape(
        center_skull=np.array(CENTER_SKULL),
        egg=egg,
        relief=(
            bumps,
            _grooves(rng, egg, (TEMPORAL_LINE,), LINE_MM),
            Waves.draw(rng, RELIEF_LENGTHS_MM, RELIEF_SDS_MM),
        ),
        sutures=_sutures(rng, egg),
        base_thickness_mm=float(base),
        template=(
            template,
            _grooves(rng, egg, MENINGEAL_GROOVES, GROOVE_MM, sign=-1.0),
            _grooves(rng, egg, (SINUS,), SINUS_MM, sign=-1.0),
            Waves.draw(rng, THICKNESS_LENGTHS_MM, THICKNESS_SDS_MM),
            *_relief(seed, INNER_STREAM, relief.inner_mm, relief.length_mm),
        ),
        diploe=Waves.draw(rng, np.array((25.0,)), np.array((0.5,))),
        texture=_uneven(rng, relief.outer_mm, TEXTURE_MM),  # the last of these draws
        step=step_relief(seed, relief),
    )


def step_relief(seed: int, relief: Relief) -> tuple[Waves, ...]:
    """Return the unevenness of the step from outer table to diploe, over places / ``HEAD_MM``."""
    return _relief(seed, STEP_STREAM, relief.step_mm, relief.length_mm)


def _relief(seed: int, stream: int, rms_mm: float, length_mm: float) -> tuple[Waves, ...]:
    return _uneven(np.random.default_rng((STREAM, seed, stream)), rms_mm, length_mm)


def _uneven(rng: np.random.Generator, rms_mm: float, length_mm: float) -> tuple[Waves, ...]:
    """Return a small unevenness; nothing where it is 0."""
    if rms_mm == 0.0:
        return ()
    return (Waves.draw(rng, np.array((length_mm,)), np.array((rms_mm,)), RELIEF_WAVES),)


def _bumps(
    rng: np.random.Generator, egg: Egg, paired: tuple[Bump, ...], single: tuple[Bump, ...]
) -> Bumps:
    sided = [(bump, side) for side in (1, -1) for bump in paired] + [(b, 0) for b in single]
    axes, widths, heights = [], [], []
    for ((behind, above), (along, across), height), side in sided:
        jitter = rng.normal(0.0, 2.0, 2)
        place = (behind + jitter[0] * abs(side), above + jitter[1])
        axes.append(tangents(direction_of(egg, place, side)))
        widths.append((along / HEAD_MM, across / HEAD_MM))
        heights.append(height * np.clip(rng.normal(1.0, 0.18), 0.6, 1.4))
    return Bumps(np.array(axes), np.array(widths), np.array(heights))


def _smear(curves: list[tuple[Floats, float]], width_mm: float) -> Curves:
    """Return curves (waypoints traced already, depth) as rows of bumps of the right height."""
    width = width_mm / HEAD_MM
    points, weights = [], []
    for curve, depth in curves:
        step = np.linalg.norm(np.diff(curve, axis=0), axis=1).mean()
        points.append(curve)
        weights.append(np.full(len(curve), depth * step / (width * np.sqrt(2.0 * np.pi))))
    return Curves(np.concatenate(points), np.concatenate(weights), width)


def _grooves(
    rng: np.random.Generator,
    egg: Egg,
    grooves: tuple[Groove, ...],
    width_mm: float,
    sign: float = 1.0,
) -> Curves:
    curves = []
    for side in (1, -1):
        for places, depth in grooves:
            shifts = rng.normal(0.0, 2.0, (len(places), 2))
            waypoints = [
                direction_of(egg, (b + d[0], a + d[1]), side)
                for (b, a), d in zip(places, shifts, strict=True)
            ]
            curve = trace_curve(np.array(waypoints), 0.6 * width_mm / HEAD_MM)
            curves.append((curve, sign * depth * np.clip(rng.normal(1.0, 0.2), 0.5, 1.5)))
    return _smear(curves, width_mm)


def _sutures(rng: np.random.Generator, egg: Egg) -> Curves:
    bregma, lambda_ = (direction_of(egg, place, 0) for place in (BREGMA, LAMBDA))
    middle = direction_of(egg, (36.0, 123.0), 0)
    paths = [(np.array((bregma, middle, lambda_)), 1.0)]
    for side in (1, -1):
        for start, places, zigzag in (
            (bregma, CORONAL, 0.7),
            (lambda_, LAMBDOID, 1.2),
            (None, SQUAMOSAL, 0.15),  # a bevel, hardly toothed
        ):
            way = [direction_of(egg, place, side) for place in places]
            paths.append((np.array(way if start is None else [start, *way]), zigzag))
    curves = []
    for waypoints, zigzag in paths:
        wiggle = np.stack(
            (
                rng.uniform(0.4, 1.0, 4) * zigzag * ZIGZAG_MM / HEAD_MM / 2.0,
                2.0 * np.pi * HEAD_MM / rng.uniform(5.0, 14.0, 4),
                rng.uniform(0.0, 2.0 * np.pi, 4),
            )
        )
        curve = trace_curve(waypoints, 0.4 * SUTURE_MM / HEAD_MM, wiggle)
        curves.append((curve, rng.uniform(0.25, 0.35)))
    return _smear(curves, SUTURE_MM)
