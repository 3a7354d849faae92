import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.materials import BRAIN, GEL, TABLE, Material
from rona_core.virtual.acoustics.layered_reflection import (
    ObliqueFactors,
    critical_angle_rad,
    oblique_step,
)

fluids = st.builds(Material, st.floats(1.3, 1.7), st.floats(0.8, 1.2))
solids = st.builds(
    lambda fast, density, share: Material(fast, density, shear_mm_per_us=share * fast),
    st.floats(2.0, 4.0),
    st.floats(1.4, 2.5),
    st.floats(0.1, 0.65),
)


@given(fluid=fluids, solid=solids, share=st.floats(0.0, 0.98))
def test_energy_is_kept(fluid, solid, share):
    angle = np.array([share * critical_angle_rad(fluid, solid)])
    found = oblique_step(fluid, solid, angle)
    # what passes there and back as pressure is what passes once as energy
    total = found.from_fluid**2 + found.through + found.shear_energy
    np.testing.assert_allclose(total, 1.0, atol=1e-12)


@given(fluid=fluids, solid=solids)
def test_perpendicular_is_the_step_of_impedances(fluid, solid):
    found = oblique_step(fluid, solid, np.zeros(1))
    z1, z2 = (m.density_g_per_cm3 * m.speed_mm_per_us for m in (fluid, solid))
    assert found.from_fluid[0] == pytest.approx((z2 - z1) / (z2 + z1))
    assert found.from_solid[0] == pytest.approx((z1 - z2) / (z2 + z1))
    assert found.shear_energy[0] == 0.0


@given(
    fluid=fluids, speed=st.floats(1.8, 3.0), density=st.floats(1.0, 2.0), angle=st.floats(0.0, 0.3)
)
def test_without_shear_it_is_the_law_of_two_fluids(fluid, speed, density, angle):
    other = Material(speed, density)
    found = oblique_step(fluid, other, np.array([angle]))
    inside = np.arcsin(np.sin(angle) * speed / fluid.speed_mm_per_us)
    z1 = fluid.density_g_per_cm3 * fluid.speed_mm_per_us / np.cos(angle)
    z2 = density * speed / np.cos(inside)
    assert found.from_fluid[0] == pytest.approx((z2 - z1) / (z2 + z1))
    assert found.from_solid[0] == pytest.approx(-found.from_fluid[0])


def test_shear_takes_what_the_literature_says_and_a_fluid_will_do_to_ten_degrees():
    angles = np.deg2rad((2.0, 5.0, 10.0))
    solid = oblique_step(GEL, TABLE, angles)
    np.testing.assert_allclose(solid.shear_energy, (0.002, 0.01, 0.039), rtol=0.15)
    fluid = oblique_step(GEL, Material(2.85, 1.9), angles)
    np.testing.assert_allclose(fluid.from_fluid[2], 0.580, atol=2e-3)
    np.testing.assert_allclose(solid.from_fluid[2], 0.561, atol=2e-3)
    apart_db = 20 * np.log10(fluid.from_fluid / solid.from_fluid)
    assert np.all(np.abs(apart_db) < 0.35)


def test_factors_are_one_at_normal_incidence_and_follow_the_law_beyond():
    factors = ObliqueFactors(BRAIN, TABLE)
    in_fluid = np.deg2rad((0.0, 4.0, 9.0))
    in_solid = np.arcsin(np.sin(in_fluid) * TABLE.speed_mm_per_us / BRAIN.speed_mm_per_us)
    exact = oblique_step(BRAIN, TABLE, in_fluid)
    for found, law in (
        (factors.front(in_fluid), exact.from_fluid),
        (factors.passage(in_fluid), exact.through),
        (factors.back(in_solid), exact.from_solid),
    ):
        np.testing.assert_allclose(found, law / law[0], atol=2e-4)
        assert found[0] == pytest.approx(1.0)


def test_a_boundary_without_echo_has_nothing_to_scale():
    np.testing.assert_array_equal(ObliqueFactors(GEL, GEL).front(np.array((0.0, 0.3))), 1.0)


def test_angles_beyond_the_critical_one_are_refused():
    beyond = critical_angle_rad(GEL, TABLE) + 1e-6
    with pytest.raises(InvalidInputError, match=r"31\.\d degrees"):
        oblique_step(GEL, TABLE, np.array([beyond]))
