"""A certificate is for one robot: any change of the model, be it a bit, gives another digest."""

import os
import subprocess
import sys
from dataclasses import fields, is_dataclass, make_dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from rona_core.devices.robots import ROBOTS, UNIVERSAL
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import ConvexBody, collision_bodies
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.pinocchio_model import pinocchio_model
from rona_core.robot.kinematics.robot_model import RobotModel, Spindle
from rona_core.robot.kinematics.rx90 import rx90
from rona_core.robot.kinematics.universal_robots import ur, urdf_path
from rona_core.robot.trajectory.joint_moves import plan_joint_move
from rona_core.robot.verification import certificate as module
from rona_core.robot.verification.certificate import NOT_COUNTED, robot_digest
from rona_core.robot.verification.verifier import verify_motion

BUILDERS = {"rx90": rx90} | {name: partial(ur, name) for name in UNIVERSAL}
COUNTS_MM, COUNTS_RAD = 2e-6, 2e-6  # of poses and bodies, whose last bits depend on the processor
every_robot = pytest.mark.parametrize("name", ROBOTS)


def milling(model):
    return model.with_tool(model.tool.with_spindle(Spindle(), (0.1, -0.2, 0.3)))


def changed(value):
    """Yield all values that differ from this one by one number, text or element, with the place."""
    if isinstance(value, Pose):
        for axis in range(3):
            step = COUNTS_MM * np.eye(3)[axis]
            yield f" + {axis}", Pose(value.rotation, value.translation + step)
            turn = Pose.from_rotvec(COUNTS_RAD * np.eye(3)[axis])
            yield f" turned {axis}", Pose(value.rotation @ turn.rotation, value.translation)
    elif is_dataclass(value):
        for field in fields(value):
            for place, other in changed(getattr(value, field.name)):
                yield f".{field.name}{place}", replace(value, **{field.name: other})
    elif isinstance(value, np.ndarray):
        for index in np.ndindex(value.shape):
            other = value.copy()
            other[index] = np.nextafter(value[index], np.inf)
            yield f"{list(index)}", other
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            for place, other in changed(item):
                yield f"[{i}]{place}", (*value[:i], other, *value[i + 1 :])
        if value and isinstance(value[0], tuple):  # as many as there happen to be
            yield " longer", (*value, value[-1])
            yield " shorter", value[:-1]
    elif isinstance(value, float):
        yield "", float(np.nextafter(value, np.inf))
    elif isinstance(value, str):
        yield "", f"{value}x"
    elif value is None:
        yield "", Spindle()
    else:
        raise AssertionError(f"the sweep has no rule for a {type(value).__name__}")


def swept(model, names):
    """Return which fields have changes, after a look that each gives another digest."""
    digest, found = robot_digest.__wrapped__(model), set()
    for name in names:
        for place, other in changed(getattr(model, name)):
            made = robot_digest.__wrapped__(replace(model, **{name: other}))
            assert made != digest, f"{name}{place}"
            found.add(name)
    return found


@pytest.mark.sweep(1)
@pytest.mark.parametrize("tool", ["probe", "spindle"])
def test_any_change_of_any_field_gives_another_digest(tool):
    model = rx90() if tool == "probe" else milling(rx90())
    names = {field.name for field in fields(model)} - set(NOT_COUNTED)
    assert swept(model, names) == names


@pytest.mark.sweep(1)
@pytest.mark.parametrize("name", ["ur5", "ur10"])
def test_any_change_of_any_length_of_an_arm_of_another_build_does_too(name):
    assert swept(BUILDERS[name](), ["arm"]) == {"arm"}


@pytest.mark.sweep(2)
@every_robot
def test_models_built_twice_have_one_digest_whatever_they_are_called(name, tmp_path):
    first, second = BUILDERS[name](), BUILDERS[name]()
    assert first is not second
    digest = robot_digest(first)
    assert robot_digest(second) == digest == robot_digest(robot_model(name))
    assert robot_digest(replace(first, name="tx2-60l")) == digest
    assert robot_digest(milling(first)) == robot_digest(milling(second)) != digest
    if first.urdf is not None:  # what the file says counts, not where it is
        copy = tmp_path / "copy.urdf"
        copy.write_bytes(urdf_path(name).read_bytes())
        assert robot_digest(replace(first, urdf=str(copy))) == digest


def test_all_robots_of_the_catalogue_differ_with_either_tool():
    models = [robot_model(name) for name in ROBOTS]
    digests = {robot_digest(model) for model in (*models, *map(milling, models))}
    assert len(digests) == 2 * len(ROBOTS)


def test_a_field_that_is_added_counts_and_one_that_cannot_be_counted_is_refused():
    model = rx90()
    held = {field.name: getattr(model, field.name) for field in fields(model)}

    def with_field(kind, value):
        added = [("added", kind, None)]
        further = make_dataclass("Model", added, bases=(RobotModel,), frozen=True, eq=False)
        return further(**held, added=value)

    digests = {robot_digest(with_field(float, kg)) for kg in (5.0, np.nextafter(5.0, 6.0))}
    assert len(digests) == 2
    assert robot_digest(model) not in digests
    with pytest.raises(InvalidInputError, match="added of a robot must be numbers"):
        robot_digest(with_field(set, {1.0}))


def moved(body, vertex, mm):
    vertices = body.vertices.copy()
    vertices[vertex, 0] += mm
    return ConvexBody(body.name, body.link, vertices)


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.slow)])
def test_another_collision_body_gives_another_digest(monkeypatch, every):
    model = rx90()
    bodies, digest = collision_bodies(model), robot_digest(model)
    others = [bodies[:-1], (*bodies, bodies[0])]
    for i, body in enumerate(bodies):
        around = partial(lambda i, other: (*bodies[:i], other, *bodies[i + 1 :]), i)
        others += [
            around(replace(body, name=f"{body.name}x")),
            around(replace(body, link=(body.link + 1) % 7)),
            around(ConvexBody(body.name, body.link, body.vertices[1:])),
            *(
                around(moved(body, vertex, COUNTS_MM))
                for vertex in range(0, len(body.vertices), every)
            ),
        ]
    for number, other in enumerate(others):
        monkeypatch.setattr(module, "collision_bodies", lambda _, other=other: other)
        assert robot_digest.__wrapped__(model) != digest, number


@pytest.mark.sweep(2)
@every_robot
def test_each_joint_of_the_verifiers_model_counts(monkeypatch, name):
    """It is read from the maker's file, which may say something else than the planner's lengths."""
    model = robot_model(name)
    digest = robot_digest(model)
    for joint in range(1, 7):
        built, flange = pinocchio_model(model)
        built.jointPlacements[joint].translation += 1e-3 * COUNTS_MM * np.eye(3)[joint % 3]
        monkeypatch.setattr(module, "pinocchio_model", lambda _, b=built, f=flange: (b, f))
        assert robot_digest.__wrapped__(model) != digest, joint
    built, flange = pinocchio_model(model)
    built.frames[flange].placement.translation += 1e-3 * COUNTS_MM * np.ones(3)
    monkeypatch.setattr(module, "pinocchio_model", lambda _: (built, flange))
    assert robot_digest.__wrapped__(model) != digest


@pytest.mark.sweep(1)
@every_robot
def test_any_pair_of_bodies_that_is_looked_at_counts(monkeypatch, name):
    model = robot_model(name)
    digest, world = robot_digest(model), CollisionWorld(model)
    for pair in world.pairs:
        left = [one for one in world.pairs if one is not pair]
        fewer = type("World", (), {"pairs": tuple(left)})
        monkeypatch.setattr(module, "CollisionWorld", lambda _, fewer=fewer: fewer)
        assert robot_digest.__wrapped__(model) != digest, pair


@pytest.mark.sweep(2)
@every_robot
def test_allowed_pairs_belong_to_the_model_and_not_to_its_name(name):
    model = BUILDERS[name]()
    named = [(pair.first, pair.second) for pair in CollisionWorld(model).pairs]
    for other in ("tx2-60l", *ROBOTS):
        world = CollisionWorld(replace(model, name=other))
        assert [(pair.first, pair.second) for pair in world.pairs] == named
    assert set(model.held_apart).isdisjoint(named)
    strict = CollisionWorld(replace(model, held_apart=())).pairs
    if name == "rx90":  # the hulls of a UR arm are too close at home already
        assert set(model.held_apart) <= {(pair.first, pair.second) for pair in strict}


PRINT = """
from rona_core.devices.robots import ROBOTS
from rona_core.robot.kinematics.catalog import milling_robot, robot_model
from rona_core.robot.verification.certificate import robot_digest
for name in ROBOTS:
    print(robot_digest(robot_model(name)), robot_digest(milling_robot(name, 2.5, (0.1, 0.2, 0.3))))
"""


@pytest.mark.slow
def test_a_robot_has_one_digest_on_every_processor():
    """BLAS has kernels of its own for each processor, which round the last bits differently."""
    found = [
        subprocess.run(
            [sys.executable, "-c", PRINT],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "OPENBLAS_CORETYPE": processor},
        ).stdout.split()
        for processor in ("Haswell", "Nehalem")
    ]
    assert len(found[0]) == 2 * len(ROBOTS)
    assert all(one == other for one, other in pairwise(found))


def longer_tool(model, mm):
    tool = model.tool
    out = Pose.from_translation((0.0, 0.0, mm))
    return model.with_tool(
        replace(
            tool, T_flange_tip=tool.T_flange_tip @ out, T_flange_probe=tool.T_flange_probe @ out
        )
    )


def slower(model, name):
    return replace(model, limits=replace(model.limits, **{name: 0.9 * getattr(model.limits, name)}))


OTHERS = {
    "a longer arm": lambda m: replace(m, arm=replace(m.arm, upper_arm_mm=500.0)),
    "a longer tool": lambda m: longer_tool(m, 200.0),
    "less room": lambda m: slower(m, "upper_rad"),
    "less speed": lambda m: slower(m, "speed_rad_per_s"),
    "less acceleration": lambda m: slower(m, "acceleration_rad_per_s2"),
    "another load": lambda m: m.with_tool(replace(m.tool, mass_kg=1.2)),
    "another tool": milling,
    "another allowed pair": lambda m: replace(m, held_apart=()),
    "another type": lambda _: robot_model("ur5"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_certificate_is_worth_nothing_for_another_robot(what):
    model = rx90()
    motion = plan_joint_move(model.home_rad, model.home_rad + 0.1, model)
    certificate = verify_motion(model, motion, obstacles=NOTHING_AROUND)
    assert certificate.certifies(motion, model, NOTHING_AROUND)
    assert certificate.certifies(motion, rx90(), NOTHING_AROUND), "an equal one"
    other = replace(OTHERS[what](model), name=model.name)
    refusal = certificate.refusal(motion, other, NOTHING_AROUND)
    assert "another robot than this rx90" in refusal
    assert refusal.endswith("plan again")
    assert not certificate.certifies(motion, other, NOTHING_AROUND)
    forged = replace(certificate, robot=robot_digest(other))
    assert not forged.certifies(motion, other, NOTHING_AROUND)
    assert "another motion" in forged.refusal(motion, other, NOTHING_AROUND)
