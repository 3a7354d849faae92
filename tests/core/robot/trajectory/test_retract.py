"""The probe is drawn straight back from where it stands."""

import numpy as np
import pytest

from rona_core.errors import NotReachableError
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.trajectory.scan_timing import RETRACT_AFTER_STOP_MM, retract_after_stop
from rona_core.robot.verification.verifier import verify_motion


def free(qs_rad):
    return np.ones(len(qs_rad), dtype=bool)


@pytest.mark.parametrize("name", ["rx90", "ur5", "ur10"])
def test_it_goes_straight_back_along_the_axis_and_nowhere_else(name):
    model = robot_model(name)
    start = model.home_rad + 0.1
    motion = retract_after_stop(model, start, free)
    np.testing.assert_array_equal(motion.qs_rad[0], start)
    probes = model.forward(motion.qs_rad) @ model.T_flange_probe
    way = probes.translations - probes.translations[0]
    axis = probes.rotations[0, :, 2]
    depths = way @ axis
    np.testing.assert_allclose(way, np.outer(depths, axis), atol=0.02)
    assert (np.diff(depths) <= 1e-9).all()
    assert depths[-1] == pytest.approx(-RETRACT_AFTER_STOP_MM, abs=1e-6)
    np.testing.assert_allclose(probes.rotations[:, :, 2] @ axis, 1.0, atol=1e-7)
    assert verify_motion(model, motion, obstacles=NOTHING_AROUND).certifies(
        motion, model, NOTHING_AROUND
    )
    assert np.abs(np.diff(depths)).max() / 0.02 < 15.2  # the speed of an approach


def test_what_is_in_the_way_and_limits_of_joints_are_told():
    model = robot_model("rx90")
    with pytest.raises(NotReachableError, match="drawn back by 9 mm only"):
        retract_after_stop(model, model.home_rad, lambda qs: np.arange(len(qs)) < 10)
    with pytest.raises(NotReachableError, match="drawn back by 0 mm only"):
        retract_after_stop(model, model.home_rad, lambda qs: np.zeros(len(qs), dtype=bool))
    with pytest.raises(NotReachableError, match=r"drawn back by \d+ mm only"):
        retract_after_stop(model, model.home_rad, free, retract_mm=2000.0)
