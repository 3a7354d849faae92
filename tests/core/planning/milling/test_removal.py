"""What a path removes: closed forms, a second way to compute it, and the quick bed beside it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import grey_dilation, grey_erosion
from scipy.spatial import KDTree

from rona_core.errors import InvalidInputError
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant, implant_named
from rona_core.planning.implants.solids import Prism, Stack, cylinder, stadium
from rona_core.planning.milling.burr import Burr, MillingSettings, ball
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.milling.plan_milling import plan_milling
from rona_core.planning.milling.removal import fit, grid_of, lowest_mm, planned_bed, removed_bed

AXIS_MM = 0.05 * np.arange(-100, 101)
SMALL = MillingSettings(burr=ball(3.0), rim_burr=ball(1.5))
ROUND = Implant("round", Stack((cylinder(9.0, 0.0, 2.0),)))
STEPPED = Implant("stepped", Stack((Prism(12.0, 8.0, 1.0, 0.0, 0.7), stadium(7.0, 5.0, 0.7, 2.2))))


def named(implant):
    return f"{implant.name}, lift {implant.lift_mm:g}"


def moved(burr, *tips):
    n = len(tips)
    zeros = np.zeros(n, dtype=np.int64)
    axes = np.tile((0.0, 0.0, -1.0), (n, 1))
    return MillingPath(np.array(tips), axes, zeros + 2, zeros, zeros, (burr,))


def volume_mm3(bed):
    return float(bed.depth_mm.sum() * (bed.x_mm[1] - bed.x_mm[0]) ** 2)


def groove_mm2(burr, depth):
    """Area of the cross section of a groove, by its closed form."""
    r = burr.corner_radius_mm
    flat = burr.radius_mm - r
    if depth >= r:
        return 2.0 * flat * depth + 0.5 * np.pi * r * r + 2.0 * r * (depth - r)
    half = np.arccos(1.0 - depth / r)
    return 2.0 * flat * depth + r * r * (half - np.sin(half) * np.cos(half))


@pytest.mark.parametrize("burr", [ball(3.0), Burr(4.0, 0.8), Burr(2.0, 0.0)], ids=str)
@pytest.mark.parametrize("depth", [0.4, 2.0])
def test_a_groove_has_its_volume(burr, depth):
    short, long = (
        removed_bed(moved(burr, (-half, 0, -depth), (half, 0, -depth)), AXIS_MM, AXIS_MM)
        for half in (1.0, 2.5)
    )
    expected = 3.0 * groove_mm2(burr, depth)  # the ends of both are the same
    lost = 0.05 * depth * 3.0 if burr.corner_radius_mm < burr.radius_mm else 0.0  # a cell of wall
    assert volume_mm3(long) - volume_mm3(short) == pytest.approx(expected, rel=0.01, abs=lost)


def test_one_plunge_of_a_ball_is_a_cap():
    bed = removed_bed(moved(ball(4.0), (0.0, 0.0, -1.2)), AXIS_MM, AXIS_MM)
    assert volume_mm3(bed) == pytest.approx(np.pi * 1.2**2 * (2.0 - 0.4), rel=0.01)
    assert bed.depth_mm.max() == pytest.approx(1.2)


def test_a_way_down_is_a_swept_ball():
    """Against the union of many balls, each by the distance to its centre."""
    ends = np.array(((-2.0, 0.5, 0.3), (2.0, -0.5, -1.5)))
    centres = ends[0] + np.linspace(0.0, 1.0, 4001)[:, None] * (ends[1] - ends[0]) + (0, 0, 1.5)
    grid = AXIS_MM[::10]
    lowest = lowest_mm(moved(ball(3.0), *ends), grid, grid)
    for i, j in ((8, 10), (10, 10), (12, 9), (13, 12)):
        away = np.hypot(centres[:, 0] - grid[i], centres[:, 1] - grid[j])
        near = away <= 1.5
        lows = centres[near, 2] - np.sqrt(1.5**2 - away[near] ** 2)
        assert lowest[i, j] == pytest.approx(lows.min(), abs=0.003)


def test_removal_is_that_of_distances_to_the_path():
    path = plan_milling(ROUND, replace(SMALL, tilt_deg=0.0))
    x_mm, y_mm = grid_of(ROUND, SMALL, 0.2)
    x, y = np.meshgrid(x_mm, y_mm, indexing="ij")
    places = np.column_stack((x.ravel(), y.ravel()))
    lowest = np.full(len(places), np.inf)
    shares = np.linspace(0.0, 1.0, 8)[:, None, None]
    for tool, burr in enumerate(path.burrs):
        tips = path.tips_bed[path.tools == tool]
        dense = (tips[:-1] + shares * (tips[1:] - tips[:-1])).reshape(-1, 3)
        for z in np.unique(np.round(dense[:, 2], 2)):
            tree = KDTree(dense[np.abs(dense[:, 2] - z) <= 0.005][:, :2])
            lowest = np.minimum(lowest, z + burr.rise_mm(tree.query(places)[0]))
    depth = np.maximum(-lowest, 0.0).reshape(x.shape)
    off = np.abs(depth - removed_bed(path, x_mm, y_mm).depth_mm)
    assert np.percentile(off, 98) <= 0.01  # but on the wall
    assert off.max() <= 0.6


@pytest.mark.sweep(2)
@pytest.mark.parametrize("implant", [ROUND, ROUND.lifted(1.6), STEPPED], ids=named)
@pytest.mark.parametrize("tilt_deg", [0.0, 15.0])
def test_the_quick_bed_is_that_of_the_path_but_for_its_ridges(implant, tilt_deg):
    settings = replace(SMALL, tilt_deg=tilt_deg)
    quick = planned_bed(implant, settings, 0.3)
    path = plan_milling(implant, settings, 0.3)
    off = quick.depth_mm - removed_bed(path, quick.x_mm, quick.y_mm).depth_mm
    ridge = settings.burr.scallop_mm(1.02 * settings.pitch * settings.burr.radius_mm)
    wall = np.zeros(off.shape, dtype=np.bool_)
    for axis in (0, 1):
        for by in (-1, 1):
            wall |= np.abs(np.roll(quick.depth_mm, by, axis) - quick.depth_mm) > 0.3
    assert wall.mean() < 0.1
    assert off[~wall].min() >= -0.005
    assert off[~wall].max() <= ridge + 0.005


@pytest.mark.parametrize("burr", [ball(3.0), Burr(3.0, 0.6)], ids=str)
def test_with_thin_layers_the_bed_is_the_opening_of_what_is_wanted_by_the_burr(burr):
    """Grey erosion and dilation of mathematical morphology, on a grid and without any outline."""
    settings = MillingSettings(burr=burr, rim_burr=None, layer_mm=0.1, tilt_deg=0.0)
    bed = planned_bed(STEPPED, settings, cell_mm=0.2)
    wide = replace(STEPPED, solid=Stack((Prism(12.6, 8.6, 1.3, 0.0, 1.0),)))
    deep = replace(STEPPED, solid=Stack((stadium(7.6, 5.6, 0.0, 2.5),)))
    wanted = np.maximum(wide.depth_mm(bed.x_mm, bed.y_mm), deep.depth_mm(bed.x_mm, bed.y_mm))
    reach = np.arange(-7, 8) * 0.2
    rise = burr.rise_mm(np.hypot(reach[:, None], reach))
    shape = np.isfinite(rise)
    low = np.where(shape, -rise, 0.0)
    tip = grey_erosion(wanted, footprint=shape, structure=low)
    opened = np.maximum(grey_dilation(tip, footprint=shape, structure=low), 0.0)
    off = np.abs(bed.depth_mm - opened)
    assert np.percentile(off, 75) <= 0.2
    assert bed.depth_mm.sum() == pytest.approx(opened.sum(), rel=0.03)


def test_a_stepped_implant_goes_in():
    settings = replace(SMALL, rim_burr=ball(1.0), side_clearance_mm=0.25)
    assert fit(STEPPED, planned_bed(STEPPED, settings)).goes_in


def test_the_quick_bed_of_a_flat_burr_is_the_bed_itself():
    settings = MillingSettings(
        burr=Burr(4.0, 0.0), rim_burr=None, tilt_deg=0.0, side_clearance_mm=0.5
    )
    bed = planned_bed(ROUND, settings)
    assert volume_mm3(bed) == pytest.approx(np.pi * 5.0**2 * 2.3, rel=0.01)
    assert set(np.unique(bed.depth_mm)) == {0.0, 2.3}


@pytest.mark.parametrize(
    "implant", [implant_named("BCI 602"), implant_named("CI receiver").lifted(1.0)], ids=named
)
def test_the_implant_goes_in_with_a_rim_pass_and_not_without(implant):
    settings = MillingSettings()
    good = fit(implant, planned_bed(implant, settings))
    assert good.goes_in
    assert good.overlap_mm == 0.0
    assert 0.0 < good.gap_min_mm < good.gap_mean_mm < 0.3
    bad = fit(implant, planned_bed(implant, replace(settings, rim_burr=None)))
    assert not bad.goes_in
    assert 0.5 < bad.overlap_mm < 1.5
    wide = settings.burr.radius_mm - settings.burr.reach_mm(settings.over_depth_mm) + 0.01
    wider = replace(settings, rim_burr=None, side_clearance_mm=wide)
    assert fit(implant, planned_bed(implant, wider)).goes_in


def test_the_fit_counts_overlap_and_gap():
    x_mm = np.arange(-6.0, 6.1, 0.25)
    depth = np.full((len(x_mm), len(x_mm)), 2.5)
    found = fit(ROUND, Bed(x_mm, x_mm, depth))
    assert (found.overlap_mm, found.gap_min_mm, found.gap_mean_mm) == (0.0, 0.5, 0.5)
    depth[len(x_mm) // 2, len(x_mm) // 2] = 1.9
    found = fit(ROUND, Bed(x_mm, x_mm, depth))
    assert found.overlap_mm == pytest.approx(0.1)
    assert not found.goes_in
    assert found.gap_min_mm == 0.0
    with pytest.raises(InvalidInputError, match="does not reach round round"):
        fit(ROUND, Bed(x_mm[20:], x_mm, depth[20:]))


def test_a_grid_that_is_too_coarse_is_refused():
    with pytest.raises(InvalidInputError, match="cell_mm must be"):
        planned_bed(ROUND, SMALL, cell_mm=5.0)
