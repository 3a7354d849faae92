"""The UR arms: what their description says, and an independent solver."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest

from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics import universal_robots
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.rx90 import rx90
from rona_core.robot.kinematics.universal_robots import provenance, ur, urdf_path
from rona_core.robot.kinematics.wrists import ParallelArm
from rona_core.robot.verification.certificate import robot_digest

NAMES = ("ur5", "ur10")
both = pytest.mark.parametrize("name", NAMES)


@both
def test_ranges_and_speeds_are_those_of_the_file(name):
    joints = ElementTree.parse(urdf_path(name)).getroot().findall("joint")
    limits = [joint.find("limit") for joint in joints if joint.get("type") == "revolute"]
    lower, upper, speed = (
        np.array([float(limit.get(key)) for limit in limits])
        for key in ("lower", "upper", "velocity")
    )
    model = robot_model(name)
    assert (model.lower_rad >= lower - 1e-12).all()
    assert (model.upper_rad <= upper + 1e-12).all()
    np.testing.assert_allclose(model.speed_rad_per_s, speed, rtol=1e-12)


@both
def test_reach_is_what_the_maker_says(name):
    """850 and 1300 mm, from axis 1 to where axes 5 and 6 cross, within the last offsets."""
    arm = robot_model(name).arm
    reach = arm.upper_arm_mm + arm.forearm_mm
    assert reach < {"ur5": 850.0, "ur10": 1300.0}[name] < reach + arm.wrist_mm + arm.side_mm


@both
def test_link_frames_end_at_the_flange_and_keep_the_lengths(name):
    model = robot_model(name)
    arm = model.arm
    for q in np.random.default_rng(3).uniform(-3.0, 3.0, (20, 6)):
        frames = model.joint_poses(q)
        flange = model.forward(q[None])[0]
        np.testing.assert_allclose(frames[6].matrix(), flange.matrix(), atol=1e-9)
        steps = np.diff(frames.translations, axis=0)
        lengths = (
            arm.shoulder_mm,
            abs(arm.shoulder_side_mm),
            np.hypot(arm.upper_arm_mm, arm.elbow_side_mm),
            np.hypot(arm.forearm_mm, arm.wrist_side_mm),
            arm.wrist_mm,
            arm.flange_mm,
        )
        np.testing.assert_allclose(np.linalg.norm(steps, axis=1), lengths, atol=1e-9)
        np.testing.assert_allclose(steps[4], arm.wrist_mm * frames.rotations[4][:, 2], atol=1e-9)


@both
def test_an_independent_solver_finds_the_same_answers(name):
    solver = pytest.importorskip("eaik.IK_HP", reason="EAIK comes with the extra 'bench'")
    model = robot_model(name)
    described = pinocchio.buildModelFromUrdf(str(urdf_path(name)))
    rotation, axes, offsets = np.eye(3), [], []
    for joint, axis in enumerate("zyyyzy", start=1):
        offsets.append(rotation @ described.jointPlacements[joint].translation)
        rotation = rotation @ described.jointPlacements[joint].rotation
        axes.append(rotation @ np.eye(3)["xyz".index(axis)])
    flange = described.frames[described.getFrameId("tool0")].placement
    offsets.append(rotation @ flange.translation)
    end = rotation @ flange.rotation  # of the flange at zero; theirs ends with none
    peer = solver.HPRobot(np.array(axes), np.array(offsets))
    poses = model.forward(np.random.default_rng(6).uniform(-3.1, 3.1, (300, 6)))
    solutions = model.inverse(poses)
    for i, pose in enumerate(poses):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation @ end.T, pose.translation / 1000.0
        found = peer.IK(matrix)
        theirs = np.array([q for q, ls in zip(found.Q, found.is_LS, strict=True) if not ls])
        ours = solutions.qs_rad[i][solutions.valid[i]]
        apart = theirs[:, None] - ours[None]
        apart = np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max(axis=2)
        assert apart.min(axis=1).max() < 1e-6  # we have each of theirs
        assert apart.min(axis=0).max() < 1e-6  # and they have each of ours


def test_a_robot_whose_description_is_not_installed_says_what_to_install(monkeypatch):
    monkeypatch.setattr(universal_robots, "FOLDER", Path("elsewhere"))
    with pytest.raises(InvalidInputError, match="pip install example-robot-data"):
        urdf_path("ur5")


def described(tmp_path, old, new):
    path = tmp_path / "other.urdf"
    text = urdf_path("ur5").read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")
    return path


def test_another_description_of_the_same_build_gives_another_arm(tmp_path):
    path = described(tmp_path, "0.425", "0.625")
    longer = ur("ur5", urdf=path)
    assert longer.arm.upper_arm_mm == pytest.approx(625.0)
    assert longer.urdf == str(path)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", ["ur5", "ur3", "ur10"])
def test_an_arm_is_called_a_ur5_if_it_has_the_lengths_of_one(name):
    other = ur("ur5", urdf=urdf_path(name))
    assert other.name == ("ur5" if name == "ur5" else f"arm of {name}_robot.urdf")
    assert robot_digest(replace(other, name="ur5")) == robot_digest(other)
    assert (robot_digest(other) == robot_digest(ur("ur5"))) == (name == "ur5")


@pytest.mark.parametrize("off_mm", [-50.0, -3.1, -2.9, -0.4, 0.4, 2.9, 3.1, 50.0, 200.0])
@pytest.mark.parametrize("old", ["0.425", "0.39225", "0.089159"])
def test_a_length_that_is_off_by_more_than_arms_of_a_type_takes_the_name(tmp_path, old, off_mm):
    """A calibrated arm keeps its name, one of another type does not, whatever it is asked as."""
    length = f"{float(old) + off_mm / 1000.0:.6f}"
    other = ur("ur5", urdf=described(tmp_path, old, length))
    assert (other.name == "ur5") == (abs(off_mm) < 3.0)
    assert other.name not in {"rx90", "ur10"}
    assert all(figure.source == "other.urdf" for figure in provenance("ur5", other.urdf)[:8])


@pytest.mark.parametrize("key", ["shoulder_mm", "upper_arm_mm", "forearm_mm", "flange_mm"])
def test_an_rx90_with_lengths_of_another_type_has_another_name_too(key):
    length = getattr(rx90().arm, key)
    for off_mm in (-50.0, -3.1, -2.9, 2.9, 3.1, 50.0):
        other = rx90({key: length + off_mm})
        assert other.name == ("rx90" if abs(off_mm) < 3.0 else "arm built like an rx90")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('xyz="0.0 -0.1197 0.425"', 'xyz="0.01 -0.1197 0.425"', "three parallel"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="1 0 0"/>', "three parallel"),
        ('rpy="0.0 1.57079632679 0.0"', 'rpy="0.0 1.0 0.0"', "three parallel"),
        (
            '<joint name="elbow_joint" type="revolute">',
            '<joint name="elbow_joint" type="fixed">',
            "six turning",
        ),
        ('<parent link="base_link"/>', '<parent link="table"/>', "cannot be read as URDF"),
        ('"tool0"', '"other"', "tool0 does not hang on base_link"),
        ('"base_link"', '"other"', "tool0 does not hang on base_link"),
        ("</robot>", "", "cannot be read as URDF"),
    ],
)
def test_a_description_of_another_build_is_refused(tmp_path, old, new, message):
    with pytest.raises(InvalidInputError, match=message):
        ur("ur5", urdf=described(tmp_path, old, new))


def test_lengths_that_make_no_arm_are_refused_by_name():
    lengths = dict.fromkeys(ParallelArm.__slots__, 100.0)
    ParallelArm(**{**lengths, "elbow_side_mm": -100.0})
    with pytest.raises(InvalidInputError, match="forearm_mm must be a positive length"):
        ParallelArm(**{**lengths, "forearm_mm": 0.0})
    with pytest.raises(InvalidInputError, match="wrist_side_mm must be a length"):
        ParallelArm(**{**lengths, "wrist_side_mm": np.nan})


def test_too_close_to_axis_one_no_branch_reaches_and_the_margin_says_by_how_much():
    arm = robot_model("ur10").arm
    pose = robot_model("ur10").forward(np.array([[0.3, -1.2, 1.4, -0.5, 1.0, 0.2]]))
    rotation = pose.rotations
    center = np.array(((30.0, 40.0, 700.0),))
    near = type(pose)(rotation, center + arm.flange_mm * rotation[:, :, 2])
    solutions = robot_model("ur10").inverse(near)
    assert not solutions.valid.any()
    assert solutions.reaches_mm[0].max() == pytest.approx(50.0 - arm.side_mm)
    assert solutions.wrist_distance_mm[0] == 0.0
