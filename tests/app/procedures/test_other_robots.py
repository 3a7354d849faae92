"""Every robot can be chosen: the room follows it, and the procedure ends with a certificate."""

import numpy as np
import pytest

from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.compose import new_workbench, run_demo
from rona_core.devices.robots import ROBOTS
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session


@pytest.mark.parametrize("name", ROBOTS)
def test_the_room_is_set_up_for_the_arm_that_is_chosen(name):
    bench = new_workbench(Session(name="other robot"))
    try:
        bench.dispatch(SetRobot(model=name))
        rig = bench.rig()
        rig.begin(bench.session.setup.devices, 0)
        center, _, _ = rig.display.region()
        model = robot_model(name)
        assert np.linalg.norm(center - model.work_area.region_base) < 15.0
        np.testing.assert_array_equal(rig.robot.state().q_rad, model.home_rad)
        bench.dispatch(Undo())
        rig.begin(bench.session.setup.devices, 1)
        np.testing.assert_array_equal(rig.robot.state().q_rad, robot_model("rx90").home_rad)
    finally:
        bench.close()


def test_an_unknown_robot_changes_nothing():
    bench = new_workbench(Session(name="other robot"))
    try:
        with pytest.raises(InvalidInputError, match=f"one of {', '.join(ROBOTS)}"):
            bench.dispatch(SetRobot(model="c3po"))
        assert bench.session.setup.devices.robot.model == "rx90"
    finally:
        bench.close()


@pytest.mark.slow
def test_the_whole_procedure_ends_with_a_certified_scan(tmp_path):
    name = "ur10"
    session, figures = run_demo(1, robot=name)
    assert figures["completed"], figures["reason"]
    assert figures["robot"] == name
    assert figures["rolls_feasible"] >= 20
    assert figures["outer_rms_mm"] < 0.5
    plan = session.results.roll.value
    assert plan.model == name
    assert plan.may_move
    again = load_session(save_session(session, tmp_path / "other.rona"))
    assert again.results.roll.value.may_move
    assert again.setup.devices.robot.model == name
