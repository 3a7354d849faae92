"""Milled beds: ridges and volumes against closed forms, the fit of the implants, and times.

What is judged is what the moves of the path remove, not the quick bed of the placement search; that
one stands beside it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely

from benchmarks.metric import Metric, Progress, cpu_ms
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant, implant_named
from rona_core.planning.implants.solids import Prism, Stack, cylinder, stadium
from rona_core.planning.milling.burr import Burr, MillingSettings, ball
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.milling.plan_milling import plan_milling
from rona_core.planning.milling.removal import (
    MOST_OVERLAP_MM,
    fit,
    grid_of,
    planned_bed,
    removed_bed,
)
from rona_core.planning.milling.tool_regions import levels

IMPLANTS = ("BCI 601", "BCI 602", "CI receiver")
LIFTS_MM = (0.0, 1.0, 2.0)
RIDGES = ((3.0, 0.5), (5.0, 0.25), (5.0, 0.5), (5.0, 0.75), (6.0, 0.5))  # diameter, pitch
RINGS = 5
VOLUME_CELL_MM = 0.05
REMOVALS = 2  # of which the faster counts
EXACT = MillingSettings(rim_burr=None, over_depth_mm=0.0, side_clearance_mm=0.0, tilt_deg=0.0)
FLAT = replace(EXACT, burr=Burr(4.0, 0.0))
FINE = replace(EXACT, pitch=0.25)


def metrics(progress: Progress) -> Iterator[Metric]:
    """Yield the figures."""
    progress("ridges")
    for diameter_mm, pitch in RIDGES:
        yield from _ridge(diameter_mm, pitch)
    progress("volumes")
    yield from _volumes()
    for name in IMPLANTS:
        progress(f"fit of {name}")
        yield from _fit(implant_named(name))
    progress("times")
    yield from _times(implant_named("BCI 602"))


def _bed(implant: Implant, settings: MillingSettings, cell_mm: float = 0.1) -> Bed:
    return removed_bed(plan_milling(implant, settings), *grid_of(implant, settings, cell_mm))


def _ridge(diameter_mm: float, pitch: float) -> Iterator[Metric]:
    """Yield the highest ridge of a floor whose rings are just one pitch apart, over the formula."""
    settings = replace(EXACT, burr=ball(diameter_mm), pitch=pitch, layer_mm=0.5)
    step_mm = pitch * settings.burr.radius_mm
    outer_mm = (RINGS + 0.5) * step_mm + settings.burr.radius_mm
    # so deep that the wall is upright, and its rings are those of every layer
    depth_mm = settings.burr.radius_mm + 0.5
    implant = Implant("disc", Stack((cylinder(2.0 * outer_mm, 0.0, depth_mm),)))
    bed = _bed(implant, settings, 0.02 * diameter_mm / 3.0)
    away = np.hypot(bed.x_mm[:, None], bed.y_mm)
    floor = away <= (RINGS + 0.5) * step_mm
    ridge_mm = depth_mm - float(bed.depth_mm[floor].min())
    radius = settings.burr.radius_mm
    share = ridge_mm / (radius - np.sqrt(radius**2 - 0.25 * step_mm**2))
    where = f"{diameter_mm:g} mm ball, pitch {pitch:g} R"
    yield Metric(f"ridge, {where}", ridge_mm, "mm", "lower")
    yield Metric(f"ridge over R - sqrt(R^2 - (s/2)^2), {where}", share, "1", "lower", 1.1)
    yield Metric(f"not less, {where}", share, "1", "higher", 0.9)


def _volumes() -> Iterator[Metric]:
    """Yield how far removed volumes are from closed forms."""
    box = Prism(16.0, 12.0, 3.0, 0.0, 4.0)
    cases: dict[str, tuple[Prism, MillingSettings, float]] = {
        "disc, flat burr": (cylinder(18.0, 0.0, 4.5), FLAT, np.pi * 81.0 * 4.5),
        "stadium, flat burr": (
            stadium(24.0, 16.0, 0.0, 4.0),
            FLAT,
            4.0 * (8.0 * 16.0 + np.pi * 64.0),
        ),
        "box, flat burr": (box, FLAT, 4.0 * (16.0 * 12.0 - (4.0 - np.pi) * 9.0)),
        "disc, ball": (cylinder(16.0, 0.0, 8.7), FINE, _ball_disc_mm3(8.0, 8.7, 2.5)),
        "disc, bull-nose": (
            cylinder(16.0, 0.0, 5.0),
            replace(FINE, burr=Burr(4.0, 1.0)),
            _ball_disc_mm3(8.0, 5.0, 1.0),
        ),
    }
    for name, (part, settings, expected_mm3) in cases.items():
        bed = _bed(Implant(name, Stack((part,))), settings, VOLUME_CELL_MM)
        removed_mm3 = float(bed.depth_mm.sum()) * VOLUME_CELL_MM**2
        off = 100.0 * abs(removed_mm3 / expected_mm3 - 1.0)
        yield Metric(f"volume off the closed form, {name}", off, "%", "lower", 1.0)


def _ball_disc_mm3(radius_mm: float, depth_mm: float, corner_mm: float) -> float:
    """Return the volume of a disc whose lower edge is rounded, at least two corners deep."""
    inner, straight = radius_mm - corner_mm, depth_mm - corner_mm
    across = 2.0 * inner * (0.25 * np.pi * corner_mm**2 + corner_mm * straight)
    round_mm3 = 2.0 / 3.0 * corner_mm**3 + corner_mm**2 * straight
    return np.pi * (inner**2 * depth_mm + across + round_mm3)


def _fit(implant: Implant) -> Iterator[Metric]:
    """Yield overlap and gap with the default settings, and what no rim pass would leave."""
    settings = MillingSettings()
    fits = [fit(one, _bed(one, settings)) for one in map(implant.lifted, LIFTS_MM)]
    overlap_mm = max(one.overlap_mm for one in fits)
    name = implant.name
    yield Metric(f"{name}: overlap, most of lifts", overlap_mm, "mm", "lower", MOST_OVERLAP_MM)
    yield Metric(f"{name}: gap, least", min(one.gap_min_mm for one in fits), "mm", "lower")
    yield Metric(f"{name}: gap, mean", fits[0].gap_mean_mm, "mm", "lower")
    bare = fit(implant, _bed(implant, replace(settings, rim_burr=None)))
    yield Metric(f"{name}: overlap without a rim pass", bare.overlap_mm, "mm", "lower")
    yield Metric(f"{name}: prefixes that are no shallower bed", _bad(implant), "", "lower", 0.0)


def _bad(implant: Implant) -> int:
    """Count layers that pass beyond the planned bed, or leave more than ridges on their floor."""
    settings = MillingSettings()
    path, found = plan_milling(implant, settings), levels(implant, settings, 0.0)
    final = planned_bed(implant, settings, cell_mm=0.2)
    x, y = np.meshgrid(final.x_mm, final.y_mm, indexing="ij")
    ridge_mm = settings.burr.scallop_mm(1.05 * settings.pitch * settings.burr.radius_mm) + 0.003
    bad, depth = 0, np.zeros(x.shape)
    for number, level in enumerate(found):
        layer = removed_bed(_layer(path, number), final.x_mm, final.y_mm)
        depth = np.maximum(depth, layer.depth_mm)
        over = depth > final.depth_mm + 0.01
        floor = np.asarray(shapely.contains_xy(level.region, x, y))
        high = floor & (depth < level.depth_mm - ridge_mm)
        bad += bool(over.any() or high.any())
    return bad


def _layer(path: MillingPath, number: int) -> MillingPath:
    """Return the moves of one layer; each begins and ends in the air."""
    own = path.layers == number
    return MillingPath(
        path.tips_bed[own],
        path.axes_bed[own],
        path.moves[own],
        path.layers[own],
        path.tools[own],
        path.burrs,
    )


def _times(implant: Implant) -> Iterator[Metric]:
    settings = MillingSettings()
    path, bed = plan_milling(implant, settings), planned_bed(implant, settings)
    removed = removed_bed(path, bed.x_mm, bed.y_mm)
    ridge_mm = settings.burr.scallop_mm(settings.pitch * settings.burr.radius_mm)
    off_mm = float((bed.depth_mm - removed.depth_mm).max())
    yield Metric("quick bed deeper than that of the path", off_mm, "mm", "lower", 1.1 * ridge_mm)
    under_mm = float((removed.depth_mm - bed.depth_mm).max())
    yield Metric("quick bed shallower than that of the path", under_mm, "mm", "lower", 0.005)
    plan_ms = cpu_ms(lambda: plan_milling(implant, settings))
    yield Metric("plan the path of the BCI 602", plan_ms, "ms", "lower", 1000.0)
    quick_ms = cpu_ms(lambda: planned_bed(implant, settings))
    yield Metric("quick bed, cells of 0.1 mm", quick_ms, "ms", "lower", 500.0)
    removal_ms = cpu_ms(lambda: removed_bed(path, bed.x_mm, bed.y_mm), REMOVALS)
    yield Metric("removal by the path, cells of 0.1 mm", removal_ms, "ms", "lower", 2000.0)
