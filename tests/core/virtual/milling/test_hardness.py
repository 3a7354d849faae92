"""The cutting force of a patient: more for more bone, hardly any on the dura, and quiet there."""

import numpy as np
import pytest

from rona_core.virtual.milling.milling_site import draw_force, measured

PLACE = np.zeros(3)


def only(layer, area=0.5):
    areas = np.zeros(4)
    areas[layer] = area
    return areas


@pytest.mark.parametrize("seed", range(300, 306))
def test_the_tables_are_harder_than_the_diploe_and_the_dura_is_soft(seed):
    force = draw_force(seed)
    outer, diploe, inner, dura = (force.of(only(layer), PLACE, 4.0) for layer in range(4))
    assert outer >= inner > diploe > 5.0 * dura > 0.0
    assert force.of(only(0, 1.0), PLACE, 4.0) == pytest.approx(2.0 * outer)
    assert force.of(only(0), PLACE, 1.0) < outer


def test_a_patient_is_the_same_every_time_and_another_is_not():
    one, same, other = draw_force(300), draw_force(300), draw_force(301)
    assert one.specific_n_per_mm2 == same.specific_n_per_mm2 != other.specific_n_per_mm2


def test_readings_scatter_with_the_force_in_bone():
    random = np.random.default_rng(0)
    bone = np.array([measured(3.0, 3.0, 0.1, random) for _ in range(2000)])
    dura = np.array([measured(0.06, 0.0, 0.1, random) for _ in range(2000)])
    assert bone[:, 0].mean() == pytest.approx(3.0, abs=0.02)
    assert bone[:, 0].std() == pytest.approx(np.hypot(0.15, 0.36) / np.sqrt(10.0), rel=0.1)
    assert dura[:, 1].mean() < 0.5 * bone[:, 1].mean()
