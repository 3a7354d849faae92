"""How far a pivot swings: cones of known width, and where each refusal begins."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.calibration.pivot.motion_extent import (
    require_cone,
    require_swing,
    swing_of_shaft_deg,
)
from rona_core.errors import DegenerateGeometryError


def cone(half_angle_deg, other_deg=None, n=720):
    """Return rotations whose z axis goes around evenly, so wide one way and so wide the other."""
    around = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    wide = np.deg2rad(half_angle_deg)
    narrow = wide if other_deg is None else np.deg2rad(other_deg)
    turns = np.column_stack((wide * np.cos(around), narrow * np.sin(around), np.zeros(n)))
    return Rotation.from_rotvec(turns).as_matrix()


def filled(half_angle_deg, other_deg=None, n=4000):
    """Return rotations spread evenly over the whole cone."""
    rng = np.random.default_rng(0)
    around, share = rng.uniform(0.0, 2.0 * np.pi, n), np.sqrt(rng.random(n))
    wide = np.deg2rad(half_angle_deg)
    narrow = wide if other_deg is None else np.deg2rad(other_deg)
    turns = (wide * share * np.cos(around), narrow * share * np.sin(around), np.zeros(n))
    return Rotation.from_rotvec(np.column_stack(turns)).as_matrix()


@pytest.mark.parametrize("angle_deg", [5.5, 20.0, 60.0])
def test_a_cone_has_its_half_angle(angle_deg):
    levers = cone(angle_deg)[:, :, 2]
    assert require_cone(levers) == pytest.approx(angle_deg, abs=1e-9)
    turned = levers @ Rotation.from_rotvec((0.4, -1.1, 0.2)).as_matrix().T
    assert require_cone(turned) == pytest.approx(angle_deg, abs=1e-9)


def test_a_narrow_cone_is_refused_with_its_width():
    with pytest.raises(DegenerateGeometryError, match=r"only 4\.5 degrees half-angle, 5 are"):
        require_cone(cone(4.5)[:, :, 2])


def test_the_swing_is_the_half_angle_of_the_even_cone_that_swings_as_much():
    weakest, strongest = swing_of_shaft_deg(filled(12.0)[:, :, 2])
    assert weakest == pytest.approx(12.0, rel=0.03)
    assert strongest == pytest.approx(12.0, rel=0.03)
    weakest, strongest = swing_of_shaft_deg(filled(12.0, 6.0)[:, :, 2])
    assert (weakest, strongest) == (pytest.approx(6.0, rel=0.03), pytest.approx(12.0, rel=0.03))


@pytest.mark.parametrize("dof", [5, 6])
@pytest.mark.parametrize(
    ("wide_deg", "narrow_deg", "words"),
    [
        (0.5, 0.5, "hardly turned"),
        (0.9, 0.0, "hardly turned"),
        (1.2, 1.2, r"covers only about ([\d.]+) degrees half-angle, 5 are needed"),
        (2.3, 2.3, r"covers only about ([\d.]+) degrees"),
        (4.3, 2.0, r"covers only about ([\d.]+) degrees"),
        (5.5, 2.0, r"stays in one plane \(([\d.]+) degrees one way, 2 the other"),
        (40.0, 0.0, r"stays in one plane \(([\d.]+) degrees"),
    ],
)
def test_a_swing_that_leaves_a_direction_open_is_refused_by_what_it_lacks(
    dof, wide_deg, narrow_deg, words
):
    with pytest.raises(DegenerateGeometryError, match=words) as caught:
        require_swing(filled(wide_deg, narrow_deg), dof)
    # with six freedoms the lever along the shaft moves both ways
    most = wide_deg if dof == 5 else np.hypot(wide_deg, narrow_deg)
    if found := re.search(words, str(caught.value)).groups():
        assert float(found[0]) == pytest.approx(most, rel=0.06)


@pytest.mark.parametrize("dof", [5, 6])
@pytest.mark.parametrize(("wide_deg", "narrow_deg"), [(2.7, 2.7), (20.0, 2.8), (6.0, 3.2)])
def test_a_swing_that_leaves_no_direction_open_is_taken(dof, wide_deg, narrow_deg):
    assert require_swing(filled(wide_deg, narrow_deg), dof) is None  # it raises what is wrong


def test_a_spin_about_the_shaft_says_nothing_of_a_pointer_with_its_tip_on_the_shaft():
    spin = Rotation.from_rotvec(np.outer(np.linspace(-0.5, 0.5, 50), (0.0, 0.0, 1.0))).as_matrix()
    with pytest.raises(DegenerateGeometryError, match="hardly turned"):
        require_swing(spin, 5)
    with pytest.raises(DegenerateGeometryError, match="stays in one plane"):
        require_swing(spin, 6)
