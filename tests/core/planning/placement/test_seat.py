import numpy as np
import pytest

from benchmarks.reference.bone_worlds import oblong_bed, round_bed
from rona_core.planning.placement.evaluate import solid_points
from rona_core.planning.placement.problem import MappedBone, Placement, lay_seats, tilted
from tests.scenes.bone_plates import AT, U, V, exact_problem, maps_of, plate

RIM = solid_points(exact_problem(plate()), oblong_bed(16.0, 10.0, 3.0)).rim
RADIUS = 80.0


def sphere():
    outer = np.sqrt(RADIUS**2 - U**2 - V**2) - RADIUS
    draws = np.repeat(outer[None], 50, axis=0)
    return MappedBone(maps_of(outer, outer - 6.0), draws, draws - 6.0)


def seat(bone, u, v, angle=0.0, rim=RIM):
    return lay_seats(bone, rim, np.array([[u, v]]), np.array([angle]))


@pytest.mark.parametrize("angle", [0.0, 0.7, 3.0])
def test_a_bed_lies_flush_on_a_leaning_plate(angle):
    lean = (0.2, -0.1)
    found = seat(plate(lean=lean), 3.0, -2.0, angle)
    normal = np.array([-lean[0], -lean[1], 1.0])
    assert found.rotations[0][:, 2] == pytest.approx(normal / np.linalg.norm(normal))
    assert found.translations[0] == pytest.approx([3.0, -2.0, 0.6 + 0.2])
    assert np.abs(found.rim_mm).max() < 1e-9
    x = found.rotations[0][:, 0]
    assert np.arctan2(x[1], x[0]) % (2 * np.pi) == pytest.approx(angle)
    assert np.linalg.det(found.rotations[0]) == pytest.approx(1.0)


def test_a_round_bed_lies_along_the_radius_of_a_sphere():
    rim = solid_points(exact_problem(sphere()), round_bed(16.0, 3.0)).rim
    found = seat(sphere(), 8.0, -5.0, rim=rim)
    outward = np.array([8.0, -5.0, np.sqrt(RADIUS**2 - 89.0)]) / RADIUS
    away = np.rad2deg(np.arccos(found.rotations[0][:, 2] @ outward))
    assert away < 0.15  # the origin is where the plane meets a line along z, not along the radius
    assert np.abs(found.rim_mm).max() < 0.04  # of a rim in cells, and of a map between its cells


def test_an_oblong_rim_stands_out_at_its_ends():
    """On a sphere bone falls off by r^2 / 2R, so by 0.26 mm more at the ends than at the sides."""
    found = seat(sphere(), 0.0, 0.0)
    along = np.abs(RIM[:, 0]) > 7.5
    assert found.rim_mm[0][along].max() < -0.08
    assert np.ptp(found.rim_mm) == pytest.approx((8.0**2 - 5.0**2) / (2 * RADIUS), abs=0.05)
    assert found.rim_mm.mean() == pytest.approx(0.0, abs=1e-3)


def test_tilt_turns_about_the_axes_of_the_bed():
    placement = Placement(0.0, 0.0, 0.5, np.deg2rad(3.0), 0.0)
    found = seat(plate(), 0.0, 0.0, 0.5)
    T_map_bed = tilted(found, 0, placement)
    assert T_map_bed.rotation[:, 0] == pytest.approx(found.rotations[0][:, 0])
    assert T_map_bed.rotation[:, 1][2] == pytest.approx(np.sin(np.deg2rad(3.0)))


def test_many_seats_are_those_of_each():
    generator = np.random.default_rng(0)
    bone = sphere()
    places, angles = generator.uniform(-8, 8, (5, 2)), generator.uniform(0, 3, 5)
    together = lay_seats(bone, RIM, places, angles)
    for k in range(5):
        alone = seat(bone, *places[k], angles[k])
        assert together.rotations[k] == pytest.approx(alone.rotations[0])
        assert together.rim_mm[k] == pytest.approx(alone.rim_mm[0])
    assert len(AT) == bone.shape[0]
