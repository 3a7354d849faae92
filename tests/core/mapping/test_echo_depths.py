"""Depths of the inner boundary from an upright pass and tilted ones."""

import numpy as np
import pytest

from rona_core.geometry.arrays import readonly
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import LocatedDetection
from rona_core.mapping.echo_depths import echo_depths
from rona_core.ultrasound.detection.detect import Detection

SPEED, RADIUS_MM, DEPTH_MM = 2.65, 80.0, 6.0


def a_pass(tilt_deg, number, *, heard=1.0, late_mm=0.0, n=400):
    """Return a pass over a sphere of bone of even thickness, the probe tilted about y."""
    rng = np.random.default_rng(number)
    out = np.column_stack((rng.uniform(-0.25, 0.25, (n, 2)), np.ones(n)))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    side = np.cross((0.0, 1.0, 0.0), out)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    tilt = np.deg2rad(tilt_deg)
    axes = -np.cos(tilt) * out + np.sin(tilt) * side
    across = np.cross(axes, side)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turns = np.stack((np.cross(across, axes), across, axes), axis=2)
    # straight on, to the sphere of the inner boundary
    inner = RADIUS_MM - DEPTH_MM
    reach = RADIUS_MM * np.cos(tilt) - np.sqrt(inner**2 - (RADIUS_MM * np.sin(tilt)) ** 2)
    ok = rng.random(n) < heard
    zero = np.zeros(n)
    detection = Detection(
        outer_us=readonly(zero + 20.0),
        inner_us=readonly(zero + 25.0),
        outer_ok=readonly(np.ones(n, dtype=np.bool_)),
        inner_ok=readonly(ok),
        outer_quality=readonly(zero + 1.0),
        inner_quality=readonly(np.where(ok, 1.0, 0.0)),
        flag=readonly(np.where(ok, 0, 6)),
        standoff_mm=readonly(zero + 5.0),
        thickness_mm=readonly(zero + reach + late_mm),
        outer_sigma_mm=readonly(zero + 0.01),
        thickness_sigma_mm=readonly(zero + 0.02),
        inner_sigma_us=readonly(zero + 0.015),
        alternative_us=readonly(zero),
        alternative_quality=readonly(zero),
        probe="2.25MHz",
        excitation="chirp",
        method="subtract",
        sound_speed_mm_per_us=SPEED,
    )
    return LocatedDetection(detection, Poses(turns, RADIUS_MM * out - 5.0 * axes))


def together(*parts):
    numbers = np.repeat(np.arange(len(parts)), [len(one.detection) for one in parts])
    poses = Poses.joined([one.Ts_base_probe for one in parts])
    return LocatedDetection(Detection.joined([one.detection for one in parts]), poses, numbers)


def test_one_pass_gives_its_sure_a_scans_as_they_are():
    upright = a_pass(0.0, 0, heard=0.6)
    found = echo_depths(upright)
    np.testing.assert_array_equal(found.scans, np.flatnonzero(upright.detection.inner_ok))
    np.testing.assert_allclose(found.depth_mm, DEPTH_MM)
    np.testing.assert_allclose(found.places_base, upright.points()[0][found.scans])
    assert found.common_sigma_mm == 0.0


@pytest.mark.parametrize("late_mm", [-0.3, 0.0, 0.4])
def test_tilted_passes_count_from_the_normal_and_without_what_they_are_off(late_mm):
    tilted = together(a_pass(5.0, 1, late_mm=late_mm), a_pass(-5.0, 2))
    found = echo_depths(a_pass(0.0, 0, heard=0.5), tilted)
    assert len(found) > 900
    np.testing.assert_allclose(found.depth_mm, DEPTH_MM, atol=0.05)
    heights = np.linalg.norm(found.places_base, axis=1)
    np.testing.assert_allclose(heights, RADIUS_MM, atol=0.05)
    assert (found.scans < 400).sum() == pytest.approx(200, abs=40)
    assert found.common_sigma_mm < 0.05


def test_a_region_that_the_upright_pass_does_not_hear_is_known_less_well():
    silent = a_pass(0.0, 0, heard=0.0)
    found = echo_depths(silent, together(a_pass(5.0, 1), a_pass(-5.0, 2)))
    assert len(found) > 700
    assert found.common_sigma_mm > 0.1
