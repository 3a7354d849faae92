"""Breakthrough by force: felt where mean and sigma fall, not where the work itself is less."""

import numpy as np

from rona_core.planning.rehearsal.breakthrough import Breakthrough
from rona_core.planning.rehearsal.site import ForceReading

STEP_MM = 0.25


def ring(count):
    turns = STEP_MM / 6.0 * np.arange(count)
    return np.column_stack((6.0 * np.cos(turns), 6.0 * np.sin(turns), np.zeros(count)))


def mill(forces, areas, feed=4.0, sigma=0.12):
    """Return the step at which a second layer is stopped, and the force by its steps; None: not."""
    watch, places = Breakthrough(9.0), ring(len(forces))
    for layer in range(2):
        watch.begin_layer(layer)
        for row, place in enumerate(places):
            force = 3.0 * areas[row] if layer == 0 else forces[row]
            reading = ForceReading(force, 0.1 + sigma * force)
            if watch.update(reading, place, float(areas[row]), feed):
                return layer, row
    return None


def test_a_force_that_falls_is_felt_within_its_recent_steps():
    areas = np.full(150, 0.6)
    forces = np.where(np.arange(150) < 100, 1.8, 0.1)
    found = mill(forces, areas)
    assert found is not None
    assert found[0] == 1
    assert 100 < found[1] <= 110


def test_harder_or_softer_bone_all_along_is_no_breakthrough():
    areas = np.full(150, 0.6)
    for share in (0.6, 1.0, 1.7):
        assert mill(np.full(150, 1.8 * share), areas) is None


def test_a_thinner_chip_is_no_breakthrough():
    areas = np.where(np.arange(150) < 100, 0.9, 0.35)
    assert mill(3.0 * areas, areas) is None


def test_the_same_force_at_less_feed_is_no_breakthrough():
    random = np.random.default_rng(0)
    areas = random.uniform(0.4, 0.8, 150)
    assert mill(3.0 * areas * random.uniform(0.8, 1.2, 150), areas, feed=1.0) is None
