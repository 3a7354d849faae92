"""Files of a motion for a controller: read back, they are the motion."""

import io
import re

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.motion_files import PERIOD_S, Pause, joints_csv, urscript
from rona_core.robot.trajectory.joint_moves import chain, joint_move
from rona_core.robot.trajectory.trajectory import sampled_motion

UR10 = robot_model("ur10")
AWAY = UR10.home_rad + 0.1
THERE = joint_move(UR10, UR10.home_rad, AWAY)
MOTION = sampled_motion(chain((THERE, joint_move(UR10, AWAY, UR10.home_rad))))
MIDDLE_S = float(MOTION.times_s[len(THERE) - 1])
ROW = r"\[([-0-9., ]+)\]"


def obeyed(script):
    """Carry out a program as its own function says; return times and the angles that are told."""
    (start,) = re.findall(rf"movej\({ROW}", script)
    before = np.array(start.split(","), dtype=float)
    times, told = [0.0], [before]
    for row, time_s in re.findall(rf"follow\({ROW}, ([0-9.]+)\)", script):
        after, steps = np.array(row.split(","), dtype=float), int(np.ceil(float(time_s) / PERIOD_S))
        for i in range(1, steps + 1):
            times.append(times[-1] + float(time_s) / steps)
            told.append(before + i / steps * (after - before))
        before = after
    return np.array(times), np.array(told)


def test_the_table_holds_times_joint_angles_and_further_columns():
    layers = list(range(len(MOTION.times_s)))
    rows = np.genfromtxt(
        io.StringIO(joints_csv(MOTION, {"layer": layers})), delimiter=",", names=True
    )
    np.testing.assert_allclose(rows["time_s"], MOTION.times_s, atol=1e-3)
    joints = np.column_stack([rows[f"q{joint}_rad"] for joint in range(1, 7)])
    np.testing.assert_allclose(joints, MOTION.qs_rad, atol=1e-7)
    np.testing.assert_array_equal(rows["layer"], layers)
    with pytest.raises(InvalidInputError, match="column layer"):
        joints_csv(MOTION, {"layer": [1]})


def test_what_the_program_tells_is_the_motion_at_every_period():
    script = urscript("ur10", MOTION, "mill_bed", "abc")
    times, told = obeyed(script)
    assert np.diff(times).max() <= PERIOD_S + 1e-9
    assert times[-1] == pytest.approx(MOTION.times_s[-1])
    meant = np.stack([np.interp(times, MOTION.times_s, q) for q in MOTION.qs_rad.T], axis=1)
    np.testing.assert_allclose(told, meant, atol=2e-6)


def test_the_program_says_units_digest_and_that_it_is_to_be_checked():
    script = urscript("ur10", MOTION, "mill_bed", "abc")
    head = script[: script.index("def mill_bed():")]
    assert "rad" in head
    assert "REDUCED SPEED" in head
    assert "# abc" in head
    assert all(line.startswith("#") for line in head.splitlines())
    blocks = re.findall(r"^ *(?:def|while) .*:$", script, re.MULTILINE)
    assert len(blocks) == len(re.findall(r"^ *end$", script, re.MULTILINE))
    assert script.splitlines()[-1] == "mill_bed()"


def test_it_waits_for_another_burr_where_it_stands_still_alone():
    script = urscript("ur10", MOTION, "mill_bed", "", [Pause(MIDDLE_S, "Another burr")])
    before, after = script.split('popup("Another burr"')
    (last,) = re.findall(rf"follow\({ROW}, [0-9.]+\)\n  stopj\(1.0\)\n  $", before)
    np.testing.assert_allclose(np.array(last.split(","), dtype=float), AWAY, atol=1e-6)
    assert "blocking=True" in after.splitlines()[0]
    with pytest.raises(InvalidInputError, match="does not stand still"):
        urscript("ur10", MOTION, "mill_bed", "", [Pause(0.5 * MIDDLE_S, "Another burr")])


def test_arms_of_others_are_refused():
    with pytest.raises(InvalidInputError, match="Universal Robots"):
        urscript("rx90", MOTION, "mill_bed", "")
