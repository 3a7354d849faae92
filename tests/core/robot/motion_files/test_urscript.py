"""URScript: carried out as its own function says it is the motion, and it is read back."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.certified import CertifiedMotion, Pause
from rona_core.robot.motion_files.urscript import PERIOD_S, read_urscript, write_urscript
from rona_core.robot.trajectory.joint_moves import chain, joint_move
from rona_core.robot.trajectory.trajectory import sampled_motion
from rona_core.robot.verification.verifier import verify_motion

UR10 = robot_model("ur10")
AWAY = UR10.home_rad + 0.1
THERE = joint_move(UR10, UR10.home_rad, AWAY)
MOTION = sampled_motion(chain((THERE, joint_move(UR10, AWAY, UR10.home_rad))))
MIDDLE_S = float(MOTION.times_s[len(THERE) - 1])
CERTIFICATE = verify_motion(UR10, MOTION, obstacles=NOTHING_AROUND)
CERTIFIED = CertifiedMotion(UR10, MOTION, CERTIFICATE, "mill_bed")
SCRIPT = write_urscript(CERTIFIED).decode()
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


def test_what_the_program_tells_is_the_motion_at_every_period():
    times, told = obeyed(SCRIPT)
    assert np.diff(times).max() <= PERIOD_S + 1e-9
    assert times[-1] == pytest.approx(MOTION.times_s[-1])
    meant = np.stack([np.interp(times, MOTION.times_s, q) for q in MOTION.qs_rad.T], axis=1)
    np.testing.assert_allclose(told, meant, atol=2e-6)


def test_the_program_says_units_digests_and_that_it_is_to_be_checked():
    head = SCRIPT[: SCRIPT.index("def mill_bed():")]
    assert "rad" in head
    assert "REDUCED SPEED" in head
    for digest in (*CERTIFIED.digests().values(), CERTIFICATE.digest):
        assert digest in head
    assert all(line.startswith("#") for line in head.splitlines())
    blocks = re.findall(r"^ *(?:def|while) .*:$", SCRIPT, re.MULTILINE)
    assert len(blocks) == len(re.findall(r"^ *end$", SCRIPT, re.MULTILINE))
    assert SCRIPT.splitlines()[-1] == "mill_bed()"


def test_it_waits_for_another_burr_where_it_stands_still_alone():
    waits = replace(CERTIFIED, pauses=[Pause(MIDDLE_S, "Another burr")])
    before, after = write_urscript(waits).decode().split('popup("Another burr"')
    (last,) = re.findall(rf"follow\({ROW}, [0-9.]+\)\n  stopj\(1.0\)\n  $", before)
    np.testing.assert_allclose(np.array(last.split(","), dtype=float), AWAY, atol=1e-6)
    assert "blocking=True" in after.splitlines()[0]
    with pytest.raises(InvalidInputError, match="does not stand still"):
        write_urscript(replace(CERTIFIED, pauses=[Pause(0.5 * MIDDLE_S, "Another burr")]))


def test_arms_of_others_are_refused():
    with pytest.raises(InvalidInputError, match="Universal Robots"):
        write_urscript(replace(CERTIFIED, model=robot_model("rx90")))


def test_movej_goes_from_rest_to_rest_as_fast_as_it_says():
    start, end = "[0.0, -1.5, 1.0, 0.0, 0.0, 0.0]", "[1.0, -1.5, 0.5, 0.0, 0.0, 0.0]"
    found = read_urscript("a", f"movej({start})\nmovej({end}, a=2.0, v=0.5)\nsleep(0.5)\n")
    whole_s = 1.0 / 0.5 + 0.5 / 2.0
    assert found.times_s[-1] == pytest.approx(whole_s + 0.5)
    speeds = np.abs(np.diff(found.qs_rad, axis=0)).max(axis=1) / np.diff(found.times_s)
    assert speeds.max() == pytest.approx(0.5, abs=1e-6)
    leading, other = found.qs_rad[:, 0], 2.0 * (1.0 - found.qs_rad[:, 2])
    np.testing.assert_allclose(leading, other, atol=1e-12)
    np.testing.assert_allclose(found.qs_rad[-1], [1.0, -1.5, 0.5, 0.0, 0.0, 0.0], atol=1e-12)
    timed = read_urscript("a", f"movej({start})\nq = {end}\nmovej(q, t=3)\n")
    assert timed.times_s[-1] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("movel(p[0.1, 0.2, 0.3, 0, 0, 0])", "line 2: 'movel"),
        ("while True:", "line 2: 'while"),
        ("movej(p[0.1, 0.2, 0.3, 0, 0, 0])", "line 2: expected six joint angles"),
        ("movej([0, 0, 0, 0, 0, 0], r=0.1)", "blend radius"),
        ("movej([0, 0, 0, 0, 0, nan])", "line 2: expected a number"),
        ("movej([0, 0, 0, 0, 0])", "six joint angles"),
        ("speedj([0.1, 0, 0, 0, 0, 0], 1, 1)", "line 2: 'speedj"),
        ("follow([0, 0, 0, 0, 0, 1], 1.0)", "line 2: 'follow"),  # whose words are not known
    ],
)
def test_what_is_not_read_is_refused_by_its_line(line, words):
    with pytest.raises(InvalidInputError, match=re.escape(words)):
        read_urscript("a.script", f"movej([0, 0, 0, 0, 0, 0])\n{line}\n")
