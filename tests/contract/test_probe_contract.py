"""What every probe keeps to, whatever is behind it."""

import dataclasses

import numpy as np
import pytest

from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.pose import Pose
from rona_core.virtual.clock import CaptureClock
from tests.helpers.sphere_world import SphereSpecimen

virtual_probe = pytest.importorskip(
    "rona_core.virtual.acoustics.probe", reason="there is no virtual probe"
)


def virtual(name, excitation):
    def build():
        specimen, clock = SphereSpecimen(), CaptureClock()
        region = specimen.region
        z = -region.normal_skull
        x = np.cross(z, (0.0, 1.0, 0.0))
        x /= np.linalg.norm(x)
        touching = Pose(np.column_stack((x, np.cross(z, x), z)), region.center_skull)
        probe = virtual_probe.VirtualProbe(
            clock, lambda times: touching.repeated(len(times)), specimen
        )
        probe.begin(ProbeSettings(name=name, excitation=excitation), 3, 1)
        return probe, clock

    return build


IMPLEMENTATIONS = {
    "virtual-2.25MHz-chirp": virtual("2.25MHz", "chirp"),
    "virtual-1MHz-pulse": virtual("1MHz", "pulse"),
}


@pytest.fixture(params=IMPLEMENTATIONS.values(), ids=IMPLEMENTATIONS.keys())
def device(request):
    probe, clock = request.param()
    yield probe, clock
    probe.close()


def test_traces_are_finite_within_full_scale_and_alike_in_shape(device):
    probe, clock = device
    scans = []
    for k in range(4):
        clock.wait_until(0.1 * k)
        scans.append(probe.acquire())
    first = scans[0]
    assert first.rf.ndim == 1
    assert len(first.rf) > 100
    assert first.sampling_mhz > 0
    for scan in scans:
        assert np.isfinite(scan.rf).all()
        assert np.abs(scan.rf).max() <= 1.0
        assert len(scan.rf) == len(first.rf)
        assert (scan.sampling_mhz, scan.start_us) == (first.sampling_mhz, first.start_us)
        assert isinstance(scan.clipped, bool)


def test_a_scan_carries_the_time_of_the_clock(device):
    probe, clock = device
    times = []
    for k in range(5):
        clock.wait_until(0.05 * k)
        times.append(probe.acquire().time_s)
    np.testing.assert_allclose(times, 0.05 * np.arange(5))
    assert clock.now() == 0.2


def test_firing_again_at_the_same_time_gives_the_same_trace_and_later_another(device):
    probe, clock = device
    a, b = probe.acquire(), probe.acquire()
    np.testing.assert_array_equal(a.rf, b.rf)
    clock.wait_until(1.0)
    assert (probe.acquire().rf != a.rf).any()


def test_samples_cannot_be_changed(device):
    probe, _ = device
    scan = probe.acquire()
    with pytest.raises(dataclasses.FrozenInstanceError):
        scan.clipped = True
    with pytest.raises(ValueError, match="read-only"):
        scan.rf[0] = 0.0


def test_closing_twice_is_safe_and_a_closed_probe_says_so(device):
    probe, _ = device
    probe.close()
    probe.close()
    with pytest.raises(DeviceError):
        probe.acquire()


def test_what_is_kept_and_collected_is_what_firing_at_once_gives(device):
    probe, clock = device
    at_once = []
    for k in range(3):
        clock.wait_until(0.1 * k)
        at_once.append(probe.acquire())
        probe.fire()
    kept = probe.collect()
    assert [scan.time_s for scan in kept] == [scan.time_s for scan in at_once]
    for a, b in zip(kept, at_once, strict=True):
        np.testing.assert_array_equal(a.rf, b.rf)
        assert a.clipped == b.clipped
    assert probe.collect() == []
