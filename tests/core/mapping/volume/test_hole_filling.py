"""Filling of holes in an echo volume: how far it reaches, and what it leaves alone."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from rona_core.mapping.volume.inner_ridge import inner_ridge
from rona_core.mapping.volume.reconstruction import VolumeSettings, fill_holes, reconstruct_volume
from tests.scenes.volume_lines import PROBE, plate

STEPS = (1.0, 1.0, 0.25)


def holes(seed=4, shape=(14, 15, 20), share=0.05):
    rng = np.random.default_rng(seed)
    amplitude = rng.uniform(0.1, 1.0, shape).astype(np.float32)
    measured = np.broadcast_to(rng.uniform(size=shape[:2])[..., None] < share, shape).copy()
    return np.where(measured, amplitude, 0).astype(np.float32), measured


@pytest.mark.parametrize("radius_mm", [0.0, 1.0, 2.5, 4.0])
def test_a_hole_is_filled_just_where_a_measured_column_is_within_the_radius(radius_mm):
    amplitude, measured = holes()
    filled = fill_holes(
        amplitude, measured, np.zeros(measured.shape[:2]), steps_mm=STEPS, radius_mm=radius_mm
    )[1]
    level = 10
    columns = np.argwhere(measured[:, :, level])
    every = np.indices(measured.shape[:2]).reshape(2, -1).T
    near = (KDTree(columns).query(every)[0] <= radius_mm).reshape(measured.shape[:2])
    np.testing.assert_array_equal(filled[:, :, level], near & ~measured[:, :, level])
    assert not (filled & measured).any()


def test_measured_voxels_keep_their_bits_and_filled_ones_lie_between_them():
    amplitude, measured = holes(share=0.3)
    tilt = np.add.outer(np.arange(14), np.arange(15)) * 0.1
    values, filled = fill_holes(amplitude, measured, tilt, steps_mm=STEPS, radius_mm=2.5)
    np.testing.assert_array_equal(values[measured], amplitude[measured])
    assert filled.any()
    assert values[filled].min() >= amplitude[measured].min()
    assert values[filled].max() <= amplitude[measured].max()
    assert not values[~filled & ~measured].any()


def test_two_columns_weigh_by_the_inverse_square_of_their_distance():
    amplitude = np.zeros((4, 1, 3), dtype=np.float32)
    measured = np.zeros(amplitude.shape, dtype=np.bool_)
    measured[0], measured[3] = True, True
    amplitude[0], amplitude[3] = 1.0, 4.0
    values, _ = fill_holes(amplitude, measured, np.zeros((4, 1)), steps_mm=STEPS, radius_mm=2.0)
    assert values[1, 0, 1] == pytest.approx((1.0 / 1 + 4.0 / 4) / (1 / 1 + 1 / 4))
    assert values[2, 0, 1] == pytest.approx((1.0 / 4 + 4.0 / 1) / (1 / 4 + 1 / 1))


def test_a_leaning_plate_keeps_its_ridge_between_rows():
    scene = plate(6.0, slope=(0.0, 0.5), rows_mm=4.0)
    bare = reconstruct_volume(*scene, PROBE, VolumeSettings(fill_radius_mm=0.0))
    whole = reconstruct_volume(*scene, PROBE, VolumeSettings(fill_radius_mm=2.5))
    np.testing.assert_array_equal(whole.measured, bare.measured)
    np.testing.assert_array_equal(whole.amplitude[bare.measured], bare.amplitude[bare.measured])
    ridge = inner_ridge(whole)
    between = ridge.ok & ~bare.measured.any(axis=2)
    assert between.sum() > 100  # two of four columns
    # at one height their neighbours would put it up to 1 mm off
    np.testing.assert_allclose(ridge.thickness_mm[between], 6.0, atol=0.1)
