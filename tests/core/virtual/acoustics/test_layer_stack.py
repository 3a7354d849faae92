from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.materials import GEL, Material
from rona_core.ultrasound.probe.probe_model import PROBES
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import BoneStack, LayerProfile
from rona_core.virtual.acoustics.medium import MEDIA, Medium
from rona_core.virtual.acoustics.microstructure import local_speed_factors

STEP = 1.0 / 2**13  # of a 14-bit converter


def bone(rng, n, *, angles=True):
    """Return rays over a bone with everything: gap, wedge, waves of all boundaries, angles."""
    slope = rng.normal(0.0, 0.03, 2)
    xy = rng.uniform(-3, 3, (n, 2))
    return LayerProfile(
        outer_mm=rng.uniform(-0.5, 0.5) + xy @ slope,
        table_mm=rng.uniform(1.2, 2.5) + rng.normal(0.0, 0.05, n),
        diploe_mm=rng.uniform(1.0, 4.0) + rng.normal(0.0, 0.05, n),
        inner_table_mm=rng.uniform(1.2, 2.5) + xy @ rng.normal(0.0, 0.1, 2),
        hit=rng.uniform(size=n) < 0.98,
        entries_skull=np.column_stack((xy, np.zeros(n))),
        outer_angle_rad=rng.uniform(0.0, 0.1, n) if angles else None,
        inner_angle_rad=rng.uniform(0.0, 0.3, n) if angles else None,
    )


@pytest.mark.parametrize("name", list(PROBES))
@pytest.mark.parametrize("profile", list(MEDIA))
def test_the_fast_way_is_the_exact_one_below_the_steps_of_the_converter(name, profile):
    rng = np.random.default_rng(4)
    medium = replace(MEDIA[profile], local_speed_sd=0.02)
    fast, exact = (EchoModel(PROBES[name], "pulse", medium, 4, exact=e) for e in (False, True))
    bones = [bone(rng, len(fast.ray_points_mm)) for _ in range(6)]
    a, b = fast.traces(bones), exact.traces(bones)
    assert np.abs(a - b).max() < 0.02 * STEP
    assert np.linalg.norm(a - b) < 1e-5 * np.linalg.norm(b)


def test_many_traces_are_the_single_ones():
    rng = np.random.default_rng(5)
    model = EchoModel(PROBES["1MHz"], "chirp", Medium(), 5)
    bones = [bone(rng, len(model.ray_points_mm)) for _ in range(4)]
    single = np.array([model.trace(one) for one in bones])
    np.testing.assert_allclose(model.traces(bones), single, atol=1e-12)
    assert model.traces(()).shape == (0, single.shape[1])


def test_one_wrong_profile_among_many_is_refused():
    rng = np.random.default_rng(6)
    model = EchoModel(PROBES["1MHz"], "pulse", Medium(), 5)
    bones = [bone(rng, n) for n in (len(model.ray_points_mm), 7)]
    with pytest.raises(InvalidInputError, match="7 rays"):
        model.traces(bones)


@settings(max_examples=10, deadline=None)
@given(factor=st.floats(0.9, 1.1))
def test_slower_bone_of_all_places_is_thicker_bone(factor):
    """A local speed counts as a thickness over it: the same as a bone that is so much thicker."""
    f = np.linspace(0.5, 4.0, 40)
    quiet = Medium(ramp_mm=0.0, outer_roughness_mm=0.0, inner_roughness_mm=0.0, speckle=0.0)
    profile = bone(np.random.default_rng(7), 12)
    thicker = replace(
        profile,
        table_mm=profile.table_mm / factor,
        diploe_mm=profile.diploe_mm / factor,
        inner_table_mm=profile.inner_table_mm / factor,
    )
    weights = np.ones((12, 40), dtype=complex)
    stack = BoneStack(GEL, quiet, f, film_mm=0.1, seed=1, exact=True)
    slow = BoneStack(GEL, replace(quiet, local_speed_sd=0.02), f, film_mm=0.1, seed=1, exact=True)
    field = local_speed_factors(profile.entries_skull, 1, 0.02)
    undone = replace(
        thicker,
        table_mm=thicker.table_mm * field,
        diploe_mm=thicker.diploe_mm * field,
        inner_table_mm=thicker.inner_table_mm * field,
    )
    np.testing.assert_allclose(
        slow.echo(weights, undone), stack.echo(weights, thicker), rtol=1e-9, atol=1e-12
    )


def test_the_local_speed_is_smooth_has_the_rms_asked_for_and_belongs_to_the_seed():
    rng = np.random.default_rng(8)
    points = rng.uniform(-300, 300, (20000, 3))
    factors = local_speed_factors(points, 3, 0.02)
    assert factors.mean() == pytest.approx(1.0, abs=2e-3)
    assert factors.std() == pytest.approx(0.02, rel=0.1)
    near = local_speed_factors(points + (1.0, 0.0, 0.0), 3, 0.02)
    assert np.abs(near - factors).max() < 0.01
    np.testing.assert_array_equal(factors, local_speed_factors(points, 3, 0.02))
    assert np.abs(factors - local_speed_factors(points, 4, 0.02)).max() > 0.01
    np.testing.assert_array_equal(local_speed_factors(points, 3, 0.0), 1.0)


def test_steep_rays_return_less_of_the_inner_boundary():
    """An oblique inner table gives compression away to shear, at 15 degrees a tenth."""
    f = np.linspace(1.5, 3.0, 30)
    quiet = Medium(outer_roughness_mm=0.0, inner_roughness_mm=0.0, speckle=0.0)
    stack = BoneStack(GEL, quiet, f, film_mm=0.0, seed=1, exact=True)
    profile = replace(bone(np.random.default_rng(9), 1, angles=False), hit=np.ones(1, dtype=bool))
    weights = np.ones((1, 30), dtype=complex)
    level = []
    nothing = replace(quiet, brain=quiet.table)
    bare = BoneStack(GEL, nothing, f, film_mm=0.0, seed=1, exact=True).echo(weights, profile)
    for degrees in (0.0, 5.0, 15.0):
        leaning = replace(profile, inner_angle_rad=np.deg2rad(np.array([degrees])))
        level.append(np.linalg.norm(stack.echo(weights, leaning) - bare))
    loss = 1.0 - np.array(level) / level[0]
    assert 0.0 < loss[1] < 0.03
    assert 0.05 < loss[2] < 0.3


@pytest.mark.parametrize("kwargs", [{"local_speed_sd": -0.1}, {"local_speed_sd": 0.2}])
def test_an_impossible_spread_of_speeds_is_refused(kwargs):
    with pytest.raises(InvalidInputError, match="local_speed_sd"):
        Medium(**kwargs)


def test_shear_faster_than_compression_is_refused():
    with pytest.raises(InvalidInputError, match="shear"):
        Material(2.0, 1.9, shear_mm_per_us=2.5)
