"""The shape of burrs in closed form, and settings that contradict one another."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.planning.milling.burr import Burr, MillingSettings, ball

BULL = Burr(6.0, 1.0)


@pytest.mark.parametrize("burr", [ball(5.0), BULL, Burr(4.0, 0.0)], ids=str)
def test_rise_and_reach_are_inverse(burr):
    heights = np.linspace(0.0, burr.corner_radius_mm, 20)
    reaches = np.array([burr.reach_mm(h) for h in heights])
    if burr.corner_radius_mm > 0.0:
        np.testing.assert_allclose(burr.rise_mm(reaches - 1e-12), heights, atol=1e-4)
    assert burr.reach_mm(50.0) == pytest.approx(burr.radius_mm)
    assert burr.rise_mm(np.array([0.0]))[0] == 0.0
    assert np.isinf(burr.rise_mm(np.array([burr.radius_mm + 1e-9]))[0])


def test_rise_in_closed_form():
    away = np.array([0.0, 1.5, 2.0])
    np.testing.assert_allclose(ball(5.0).rise_mm(away), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(BULL.rise_mm(np.array([2.0, 2.6])), [0.0, 0.2])
    np.testing.assert_allclose(Burr(4.0, 0.0).rise_mm(away), 0.0)


def test_the_ridge_between_cuts():
    assert ball(5.0).scallop_mm(1.25) == pytest.approx(2.5 - np.sqrt(2.5**2 - 0.625**2))
    assert ball(5.0).scallop_mm(1.25) == pytest.approx(0.079, abs=5e-4)
    assert Burr(5.0, 0.0).scallop_mm(1.25) == 0.0
    assert BULL.scallop_mm(3.9) == 0.0
    assert BULL.scallop_mm(4.0 + 1.2) == pytest.approx(0.2)
    assert ball(5.0).scallop_mm(6.0) == 2.5


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ball(0.2), "diameter_mm must be 0.5 to 12"),
        (lambda: Burr(4.0, 2.1), "corner_radius_mm must be 0 to 2"),
        (lambda: MillingSettings(layer_mm=0.0), "layer_mm must be"),
        (lambda: MillingSettings(pitch=1.5), "pitch must be"),
        (lambda: MillingSettings(over_depth_mm=-0.1), "over_depth_mm must be"),
        (lambda: MillingSettings(side_clearance_mm=float("nan")), "side_clearance_mm must be"),
        (lambda: MillingSettings(tilt_deg=50.0), "tilt_deg must be"),
        (lambda: MillingSettings(ramp_deg=0.0), "ramp_deg must be"),
        (lambda: MillingSettings(retract_mm=0.0), "retract_mm must be"),
        (lambda: MillingSettings(layer_mm=1.1), "thicker than the radius of a burr of 2 mm"),
        (lambda: MillingSettings(rim_burr=Burr(2.0, 0.0)), "no ball.*set tilt_deg to 0"),
        (lambda: MillingSettings(tilt_deg=5.0), "ramp_deg 5 must be below tilt_deg 5"),
        (lambda: MillingSettings(rim_burr=ball(6.0)), "must not be larger"),
    ],
)
def test_settings_that_cannot_be_are_refused(make, words):
    with pytest.raises(InvalidInputError, match=words):
        make()
