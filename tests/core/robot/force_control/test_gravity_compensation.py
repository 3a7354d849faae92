"""Weighing the tool, and taking its weight off the readings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.devices.wrench import JR3
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.robot.force_control.gravity_compensation import (
    GRAVITY_BASE,
    fit_tool_load,
    force_range_n,
    lever_mm,
    mass_disagreement,
    pressing_force_n,
)
from rona_core.robot.kinematics.catalog import robot_model
from tests.helpers.tool_weight import weight_wrench


def readings(seed, n=6, noise_n=0.0):
    rng = np.random.default_rng(seed)
    mass, com = rng.uniform(0.1, 1.0), rng.uniform(-80, 80, 3)
    offset = np.concatenate((rng.normal(0, 2, 3), rng.normal(0, 60, 3)))
    rotations = Rotation.random(n, rng=rng).as_matrix()
    wrenches = []
    for rotation in rotations:
        weight = rotation.T @ (mass * GRAVITY_BASE)
        wrenches.append(np.concatenate((weight, np.cross(com, weight))) + offset)
    noise = rng.normal(0.0, 1.0, (n, 6)) * np.repeat((noise_n, 80.0 * noise_n), 3)
    return rotations, np.array(wrenches) + noise, mass, com, offset


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_without_noise_the_tool_is_weighed_exactly(seed):
    rotations, wrenches, mass, com, offset = readings(seed)
    load = fit_tool_load(rotations, wrenches)
    assert load.mass_kg == pytest.approx(mass, rel=1e-9)
    np.testing.assert_allclose(load.com_sensor_mm, com, atol=1e-7)
    np.testing.assert_allclose(load.offset, offset, atol=1e-7)
    assert load.residual_n < 1e-9


def test_what_is_left_over_is_the_noise():
    residuals = []
    for seed in range(40):
        rotations, wrenches, *_ = readings(seed, n=20, noise_n=0.03)
        residuals.append(fit_tool_load(rotations, wrenches).residual_n)
    assert np.mean(residuals) == pytest.approx(0.03 * np.sqrt(56 / 60), rel=0.05)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), force_n=st.floats(-20.0, 20.0))
def test_the_weight_is_taken_off_in_every_orientation(seed, force_n):
    rotations, wrenches, *_ = readings(seed)
    load = fit_tool_load(rotations, wrenches)
    rng = np.random.default_rng(seed + 1)
    rotation = Rotation.random(rng=rng).as_matrix()
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    touched = weight_wrench(load, rotation) + np.concatenate((-force_n * axis, rng.normal(size=3)))
    assert pressing_force_n(load, rotation[2], touched, axis) == pytest.approx(force_n, abs=1e-9)


def test_two_newton_of_weight_would_be_felt_without():
    load = fit_tool_load(*readings(0)[:2])
    up, down = np.eye(3), np.diag((1.0, -1.0, -1.0))
    swing = weight_wrench(load, up)[2] - weight_wrench(load, down)[2]
    assert abs(swing) == pytest.approx(2.0 * load.mass_kg * 9.80665)


def test_too_few_or_too_similar_poses_are_refused():
    rotations, wrenches, *_ = readings(1)
    with pytest.raises(DegenerateGeometryError, match="too few"):
        fit_tool_load(rotations[:3], wrenches[:3])
    about_one = Rotation.from_euler("y", np.linspace(0, 40, 6)[:, None], degrees=True).as_matrix()
    with pytest.raises(DegenerateGeometryError, match="too little"):
        fit_tool_load(np.repeat(about_one[:1], 6, axis=0), wrenches)
    with pytest.raises(DegenerateGeometryError, match="weigh"):
        fit_tool_load(rotations, np.zeros((6, 6)))
    with pytest.raises(InvalidInputError):
        fit_tool_load(rotations, wrenches[:, :3])


def test_the_torque_range_does_not_limit_the_force_of_the_tool():
    model = robot_model("rx90")
    assert lever_mm(model) == pytest.approx(60.0)
    assert JR3.torque_range_nmm / JR3.force_range_n == pytest.approx(79.4, abs=0.05)
    assert force_range_n(model, JR3) == JR3.force_range_n


def test_a_longer_lever_would_limit_it():
    from dataclasses import replace

    from rona_core.geometry.pose import Pose

    model = robot_model("rx90")
    far = Pose(model.T_flange_probe.rotation, model.T_flange_probe.translation + (0.0, 0.0, 40.0))
    longer = replace(model, tool=replace(model.tool, T_flange_probe=far))
    assert lever_mm(longer) == pytest.approx(100.0)
    assert force_range_n(longer, JR3) == pytest.approx(50.0)


def test_the_error_of_the_mass_is_as_large_as_its_sigma():
    shares = []
    for seed in range(400):
        rotations, wrenches, mass, *_ = readings(seed, noise_n=0.05)
        load = fit_tool_load(rotations, wrenches)
        shares.append((load.mass_kg - mass) / load.mass_sigma_kg)
    assert np.median(np.abs(shares)) == pytest.approx(0.695, abs=0.1)  # of t with 14 freedoms


@settings(max_examples=50, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    sigmas=st.floats(-8.0, 8.0).filter(lambda share: abs(abs(share) - 3.0) > 1e-6),
    stated_sigma=st.floats(0.0, 0.05),
)
def test_a_weighed_mass_more_than_three_sigmas_off_is_reported(seed, sigmas, stated_sigma):
    rotations, wrenches, *_ = readings(seed, noise_n=0.05)
    load = fit_tool_load(rotations, wrenches)
    off_kg = sigmas * np.hypot(load.mass_sigma_kg, stated_sigma)
    tool = replace(
        robot_model("rx90").tool, mass_kg=load.mass_kg - off_kg, mass_sigma_kg=stated_sigma
    )
    found = mass_disagreement(load, tool)
    assert (found is not None) == (abs(sigmas) > 3.0)
    if found is not None:
        assert f"{1000 * load.mass_kg:.0f} ±" in found
        assert "Check what is on the flange and scan again" in found
