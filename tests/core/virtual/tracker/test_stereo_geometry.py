"""Two cameras: the closed form against triangulation, and exact figures over each volume."""

from dataclasses import dataclass

import numpy as np
import pytest

from rona_core.devices.settings import TrackerSettings
from rona_core.devices.trackers import PYRAMID, SILO, VOLUMES
from rona_core.virtual.tracker.marker_error import (
    SPECS,
    marker_error,
    moments_of,
    sample_volume,
    volume_grid,
)

STEREO = ("polaris", "spectra", "vega")


@dataclass(frozen=True, slots=True)
class StereoPair:
    """Two parallel cameras, at -b/2 and b/2 along x."""

    baseline_mm: float
    pixel_over_focal: float  # s / f, the error of a direction in radians

    def sigmas_mm(self, depths_mm):
        """Return the standard deviations (n, 3) along x, y and z at depths (n,)."""
        lateral = depths_mm * self.pixel_over_focal / np.sqrt(2.0)
        depth = np.sqrt(2.0) * depths_mm**2 * self.pixel_over_focal / self.baseline_mm
        return np.stack((lateral, lateral, depth), axis=1)


def stereo_pair(volume, depth_ratio, rms_mm):
    """Return the cameras with a 3D RMS error and a ratio of depth to lateral over a volume.

    Args:
        volume: Over which the RMS is taken, evenly.
        depth_ratio: RMS in depth over RMS in either lateral direction.
        rms_mm: 3D RMS.
    """
    moments = moments_of(volume)
    baseline_mm = 2.0 * moments.z2_mm2 / (moments.z_mm * depth_ratio)
    lateral_mm = rms_mm / np.sqrt(2.0 + depth_ratio**2)
    return StereoPair(baseline_mm, float(np.sqrt(2.0) * lateral_mm / moments.z_mm))


def test_the_closed_form_is_what_triangulation_scatters():
    pair = StereoPair(baseline_mm=500.0, pixel_over_focal=4e-5)
    point = np.array((120.0, -60.0, 1800.0))
    rng = np.random.default_rng(0)
    left, right = (
        np.array(((point[0] + side) / point[2], point[1] / point[2]))
        + pair.pixel_over_focal * rng.standard_normal((200_000, 2))
        for side in (250.0, -250.0)
    )
    z = pair.baseline_mm / (left[:, 0] - right[:, 0])
    # a lateral error is that at the true depth: the error along the line of sight counts as depth
    lateral = point[2] * 0.5 * (left + right)
    sigmas = pair.sigmas_mm(point[2:])[0]
    np.testing.assert_allclose(lateral.std(axis=0), sigmas[:2], rtol=0.01)
    assert z.std() == pytest.approx(sigmas[2], rel=0.01)


@pytest.mark.parametrize("volume", [SILO, PYRAMID])
def test_doubling_the_distance_doubles_lateral_errors_and_quadruples_depth(volume):
    pair = stereo_pair(volume, 3.0, 0.05)
    near, far = pair.sigmas_mm(np.array((1000.0, 2000.0)))
    np.testing.assert_allclose(far / near, (2.0, 2.0, 4.0), rtol=1e-12)
    assert near[2] / near[0] == pytest.approx(2.0 * 1000.0 / pair.baseline_mm)


@pytest.mark.parametrize("depth_ratio", [1.0, 3.0, 6.5])
@pytest.mark.parametrize("volume", [SILO, PYRAMID])
def test_the_pair_has_the_rms_and_the_ratio_over_the_volume(volume, depth_ratio):
    points = volume_grid(volume)
    sigmas = stereo_pair(volume, depth_ratio, 0.05).sigmas_mm(points[:, 2])
    rms = np.sqrt((sigmas**2).mean(axis=0))
    assert np.linalg.norm(rms) == pytest.approx(0.05, rel=1e-9)
    assert rms[2] / rms[0] == pytest.approx(depth_ratio, rel=1e-9)


@pytest.mark.parametrize("profile", STEREO)
def test_the_white_noise_of_a_profile_is_that_of_its_pair(profile):
    settings = TrackerSettings(profile=profile, depth_ratio=4.0)
    pair = stereo_pair(VOLUMES[profile], 4.0, SPECS[profile].white_mm)
    points = sample_volume(50, np.random.default_rng(1), VOLUMES[profile])
    np.testing.assert_allclose(
        marker_error(settings, 5).sigmas_mm(points), pair.sigmas_mm(points[:, 2]), rtol=1e-9
    )


@pytest.mark.parametrize("seed", [0, 5])
@pytest.mark.parametrize("profile", STEREO)
@pytest.mark.parametrize("depth_ratio", [2.0, 3.0])
def test_errors_have_the_figure_of_the_profile_over_its_volume(profile, seed, depth_ratio):
    error = marker_error(TrackerSettings(profile=profile, depth_ratio=depth_ratio), seed)
    rng = np.random.default_rng(7)
    points = sample_volume(20_000, rng, VOLUMES[profile])
    off = error.measure(points, rng.standard_normal(points.shape)) - points
    rms = np.sqrt((off**2).mean(axis=0))
    assert np.linalg.norm(rms) == pytest.approx(SPECS[profile].total_mm, rel=0.015)
    assert rms[2] / np.sqrt(rms[0] * rms[1]) == pytest.approx(depth_ratio, rel=0.03)
    # exact where it is scaled: over the even grid
    grid = volume_grid(VOLUMES[profile], 36)
    field = np.sqrt((error.bias_mm(grid) ** 2).sum(axis=1).mean())
    total = np.hypot(field, SPECS[profile].white_mm)
    assert total == pytest.approx(SPECS[profile].total_mm, rel=1e-9)


@pytest.mark.parametrize("profile", STEREO)
def test_averaging_leaves_the_field(profile):
    error = marker_error(TrackerSettings(profile=profile), 3)
    rng = np.random.default_rng(2)
    points = sample_volume(300, rng, VOLUMES[profile])
    mean = np.mean(
        [error.measure(points, rng.standard_normal(points.shape)) - points for _ in range(400)],
        axis=0,
    )
    left = np.sqrt(((mean - error.bias_mm(points)) ** 2).sum(axis=1).mean())
    assert left < 0.1 * SPECS[profile].white_mm
    assert np.sqrt((mean**2).sum(axis=1).mean()) > 0.6 * SPECS[profile].total_mm


def test_errors_grow_with_the_distance_only_with_stereo():
    near, far = np.array([[0.0, 0.0, 1450.0]]), np.array([[0.0, 0.0, 2350.0]])
    grown = marker_error(TrackerSettings(), 1)
    assert grown.sigmas_mm(far)[0, 2] > 2.5 * grown.sigmas_mm(near)[0, 2]
    even = marker_error(TrackerSettings(stereo=False), 1)
    np.testing.assert_array_equal(even.sigmas_mm(far), even.sigmas_mm(near))


def test_profiles_without_cameras_ignore_the_ratio_and_the_distance():
    for profile in ("ideal", "white035"):
        a = marker_error(TrackerSettings(profile=profile, depth_ratio=6.0), 1)
        b = marker_error(TrackerSettings(profile=profile, stereo=False), 1)
        np.testing.assert_array_equal(a.white_mm, b.white_mm)
        assert a.moments is None


@pytest.mark.parametrize("volume", [SILO, PYRAMID])
def test_volumes_contain_what_lies_within_their_outline(volume):
    for z in (volume.near_mm + 1.0, 2000.0, volume.far_mm - 1.0):
        ring = volume.section(z)
        np.testing.assert_allclose(ring[0], ring[-1], atol=1e-9)
        middle = np.array((0.0, 0.0, z))
        assert volume.contains(middle + 0.999 * (ring - middle))[np.hypot(*ring.T[:2]) < 1e9].all()
        assert not volume.contains(middle + 1.001 * (ring - middle)).any()
    assert not volume.contains([(0, 0, volume.near_mm - 1), (0, 0, volume.far_mm + 1)]).any()


def test_the_pyramid_has_the_sizes_that_its_maker_states():
    np.testing.assert_allclose(2.0 * PYRAMID.half_mm(950.0), (480.0, 448.0))
    np.testing.assert_allclose(2.0 * PYRAMID.half_mm(2400.0), (1566.0, 1312.0))


def test_moments_of_a_thin_slice_are_those_of_its_depth():
    from rona_core.devices.trackers import Pyramid

    slice_ = Pyramid(1999.0, 2001.0, (100.0, 100.0), (100.0, 100.0))
    moments = moments_of(slice_)
    assert moments.z_mm == pytest.approx(2000.0, rel=1e-6)
    assert moments.z2_mm2 == pytest.approx(4e6, rel=1e-6)
