"""The beam of the disc in 3-D against solutions without rays."""

import numpy as np
import pytest

from rona_core.ultrasound.probe.beam import probe_beam
from tests.oracles import disc_oracle
from tests.oracles.disc_oracle import curved, ideal_probe, leaning

PROBE_NAMES = ("2.25MHz", "1MHz")


@pytest.mark.ci
def test_the_two_oracles_are_one_on_flat_bone(monkeypatch):
    """All plane waves, and Huygens' points on a wide face: level and time of both echoes."""
    monkeypatch.setattr(disc_oracle, "FACE", 2.0)
    monkeypatch.setattr(disc_oracle, "RINGS", 36)
    probe = ideal_probe("1MHz")
    f = probe_beam(probe).frequencies_mhz
    points = np.array([disc_oracle._huygens(probe, float(one), 1e6) for one in f])
    waves = disc_oracle._angular_spectrum(probe, f, 0.0)
    found = disc_oracle._compared(probe, points, waves)
    assert abs(found.front_db) < 0.03
    assert abs(found.inner_db) < 0.03
    assert max(abs(found.front_ns), abs(found.inner_ns)) < 2.5


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", PROBE_NAMES)
@pytest.mark.parametrize("lean_deg", [0.0, 1.0, 2.0])
def test_rays_of_leaning_bone_are_as_loud_as_all_plane_waves(name, lean_deg):
    found = leaning(name, lean_deg)
    assert abs(found.front_db) < 0.25
    assert abs(found.front_ns) < 5.0
    assert abs(found.inner_db) < 0.75
    assert abs(found.inner_ns) < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBE_NAMES)
def test_rays_of_leaning_bone_hold_at_five_degrees(name):
    """Where the outer echo is in the null of the beam, and later looks lean."""
    found = leaning(name, 5.0)
    assert abs(found.front_db) < 0.5
    assert abs(found.front_ns) < 15.0
    assert abs(found.inner_db) < 0.75
    assert abs(found.inner_ns) < 15.0


@pytest.mark.ci
def test_rays_of_curved_bone_are_as_loud_as_huygens_points():
    found = curved("1MHz", 80.0)
    assert abs(found.front_db) < 0.15
    assert abs(found.front_ns) < 7.5
    assert abs(found.inner_db) < 1.5
