"""Paths stay in the bed, every prefix is a shallower bed, and the pole of a tilted ball is idle."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from rona_core.errors import InvalidInputError
from rona_core.planning.implants.implant import Implant, implant_named
from rona_core.planning.implants.solids import (
    Prism,
    Stack,
    cylinder,
    stadium,
)
from rona_core.planning.milling.burr import Burr, MillingSettings, ball
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.planning.milling.plan_milling import plan_milling
from rona_core.planning.milling.removal import grid_of, lowest_mm, removed_bed
from rona_core.planning.milling.tool_regions import levels, pocket_of, region_at

SMALL = MillingSettings(burr=ball(3.0), rim_burr=ball(1.5))
FLAT = replace(SMALL, burr=Burr(3.0, 0.5), rim_burr=Burr(1.0, 0.0), tilt_deg=0.0)
ROUND = Implant("round", Stack((cylinder(9.0, 0.0, 2.0),)))
STEPPED = Implant("stepped", Stack((Prism(12.0, 8.0, 1.0, -1.0, 0.7), stadium(7.0, 5.0, 0.7, 2.2))))


CASES = {
    "round": (ROUND, SMALL, 0.0),
    "stepped": (STEPPED, SMALL, 0.0),
    "under a dome": (ROUND, SMALL, 0.8),
    "flat burrs": (STEPPED, FLAT, 0.3),
    "one burr": (ROUND, replace(SMALL, rim_burr=None), 0.0),
    "lifted": (ROUND.lifted(1.6), SMALL, 0.0),
}


def wanted_mm(implant, settings, x_mm, y_mm):
    """Depth (nx, ny) that must not be passed, by containment in its regions."""
    x, y = np.meshgrid(x_mm, y_mm, indexing="ij")
    depth = np.zeros(x.shape)
    for terrace in pocket_of(implant, settings):
        region = terrace.region.buffer(0.01)  # polygons of arcs
        depth[shapely.contains_xy(region, x, y)] = terrace.depth_mm
    return depth


@pytest.fixture(scope="module", params=CASES)
def case(request):
    implant, settings, surface_mm = CASES[request.param]
    return implant, settings, surface_mm, plan_milling(implant, settings, surface_mm)


@pytest.mark.sweep(3)
def test_every_prefix_is_a_valid_shallower_bed(case):
    implant, settings, surface_mm, path = case
    x_mm, y_mm = grid_of(implant, settings, 0.2)
    x, y = np.meshgrid(x_mm, y_mm, indexing="ij")
    most = wanted_mm(implant, settings, x_mm, y_mm)
    lowest = np.full(most.shape, np.inf)
    found = levels(implant, settings, surface_mm)
    assert path.layers[-1] == len(found) - 1
    for number, level in enumerate(found):
        own = part_of(path, np.flatnonzero(path.layers == number))
        lowest = np.minimum(lowest, lowest_mm(own, x_mm, y_mm))
        depth = np.maximum(-lowest, 0.0)
        assert (depth <= most + 1e-3).all()
        burr = settings.burrs[level.burr]
        if level.wanted is None:
            assert depth.max() <= max(level.depth_mm, 0.0) + 1e-9
            floor = shapely.contains_xy(level.region, x, y)
            ridge = burr.scallop_mm(1.05 * settings.pitch * burr.radius_mm) + 0.003
            assert (depth[floor] >= level.depth_mm - ridge).all()
    np.testing.assert_array_equal(depth, removed_bed(path, x_mm, y_mm).depth_mm)


def test_moves_in_the_air_take_no_bone(case):
    implant, settings, surface_mm, path = case
    x_mm, y_mm = grid_of(implant, settings, 0.2)
    bone = np.full((len(x_mm), len(y_mm)), surface_mm)
    ends = np.flatnonzero(path.moves == Move.RETRACT)
    runs = np.split(np.arange(len(path)), ends)  # each begins with the end of a move in the air
    for last, run in zip([None, *runs[:-1]], runs, strict=True):
        if not len(run):
            continue
        if last is not None and len(last):
            air = part_of(path, np.array([last[-1], run[0]]))
            if air.tools[0] == air.tools[1]:
                assert (lowest_mm(air, x_mm, y_mm) >= bone - 1e-9).all()
        bone = np.minimum(bone, lowest_mm(part_of(path, run), x_mm, y_mm))


def part_of(path, rows):
    fields = (path.tips_bed, path.axes_bed, path.moves, path.layers, path.tools)
    return MillingPath(*(values[rows] for values in fields), path.burrs)


def test_the_burr_goes_down_along_ramps_alone(case):
    _, settings, _, path = case
    steps = np.diff(path.bottoms_bed(), axis=0)
    cutting = path.moves[1:] != Move.RETRACT
    down = -steps[:, 2] / np.maximum(np.linalg.norm(steps[:, :2], axis=1), 1e-12)
    turned = np.linalg.norm(steps, axis=1) < 1e-9
    assert down[cutting & ~turned].max() <= np.tan(np.deg2rad(settings.ramp_deg)) + 1e-6
    level = np.isin(path.moves[1:], (Move.CUT, Move.RIM))
    np.testing.assert_allclose(steps[level, 2], 0.0, atol=1e-9)
    assert (path.moves == Move.ENTRY).any()
    assert ((path.moves == Move.RIM) <= (path.tools == 1)).all()


def test_the_pole_of_a_tilted_ball_is_never_at_its_front(case):
    _, settings, _, path = case
    axes, steps = path.axes_bed, np.diff(path.bottoms_bed(), axis=0)
    np.testing.assert_allclose(-axes[:, 2], np.cos(settings.tilt_rad), atol=1e-12)
    cutting = (path.moves[1:] != Move.RETRACT) & (np.linalg.norm(steps, axis=1) > 1e-9)
    forward = steps[cutting] / np.linalg.norm(steps[cutting], axis=1, keepdims=True)
    if settings.tilt_rad > 0.0:
        for ends in (axes[1:], axes[:-1]):
            assert np.einsum("ij,ij->i", ends[cutting], forward).max() < 0.0


def test_an_upright_ball_cuts_with_its_pole_on_its_way_down():
    path = plan_milling(ROUND, replace(SMALL, tilt_deg=0.0))
    down = np.diff(path.tips_bed, axis=0)[path.moves[1:] == Move.ENTRY]
    assert (np.einsum("ij,j->i", down, (0.0, 0.0, -1.0)) > 0.0).all()
    np.testing.assert_array_equal(path.tips_bed, path.bottoms_bed())


def test_tilt_changes_nothing_of_what_is_cut():
    x_mm, y_mm = grid_of(ROUND, SMALL, 0.2)
    beds = [
        removed_bed(plan_milling(ROUND, replace(SMALL, tilt_deg=tilt)), x_mm, y_mm).depth_mm
        for tilt in (0.0, 30.0)
    ]
    np.testing.assert_allclose(*beds, atol=0.003)


def test_layers_are_even_and_end_on_every_floor():
    found = levels(STEPPED, SMALL, 0.0)
    main = [level.depth_mm for level in found if level.wanted is None]
    np.testing.assert_allclose(main, [0.5, 1.0, 1.5, 2.0, 2.5])
    assert region_at(pocket_of(STEPPED, SMALL), 1.0).area > 80.0
    assert region_at(pocket_of(STEPPED, SMALL), 1.01).area < 50.0
    assert region_at(pocket_of(STEPPED, SMALL), 2.6).is_empty
    assert levels(ROUND, SMALL, 0.7)[0].above_mm == -0.7


def test_a_burr_that_is_larger_than_the_bed_is_refused():
    screw = implant_named("Osia/Baha screw")
    with pytest.raises(InvalidInputError, match=r"burr of 5 mm is larger than the bed.*4\.6 mm"):
        plan_milling(screw)
    path = plan_milling(screw, SMALL)
    assert path.layers[-1] > 7
    with pytest.raises(InvalidInputError, match="surface_mm must be 0 to 10"):
        plan_milling(ROUND, SMALL, surface_mm=-1.0)


def test_the_moves_add_up_to_the_whole_path():
    path = plan_milling(ROUND, SMALL)
    parts = sum(path.length_mm(move) for move in Move)
    assert parts == pytest.approx(path.length_mm())
