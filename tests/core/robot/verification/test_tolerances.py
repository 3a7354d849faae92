"""What the verifier insists on is part of a certificate: each number, to the last bit."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.trajectory.joint_moves import plan_joint_move
from rona_core.robot.verification import certificate, motion_checks, tolerances, verifier
from rona_core.robot.verification.tolerances import (
    CuttingTolerances,
    Tolerances,
    tolerances_digest,
)
from rona_core.robot.verification.verifier import verify_motion

RX90 = robot_model("rx90")
OF_DIGESTS = ("DIGEST_DECIMALS", "MM_PER_M")  # how a robot is written down, no tolerance
CONSTANTS = [name for name in vars(tolerances) if name.isupper()]


def next_to(value):
    return value + 1 if isinstance(value, int) else float(np.nextafter(value, np.inf))


def variants(insisted):
    """Yield copies of tolerances in which one number each is the next one that there is."""
    for field in fields(insisted):
        value = getattr(insisted, field.name)
        if is_dataclass(value):
            yield from (replace(insisted, **{field.name: one}) for one in variants(value))
        else:
            yield replace(insisted, **{field.name: next_to(value)})


@pytest.fixture(scope="module")
def move():
    return plan_joint_move(RX90.home_rad, RX90.home_rad + 0.1, RX90)


def test_every_tolerance_counts():
    every = [Tolerances(), *variants(Tolerances())]
    every += [CuttingTolerances(), *variants(CuttingTolerances())]
    assert len(every) > 30
    assert len({tolerances_digest(one) for one in every}) == len(every)
    assert tolerances_digest(Tolerances()) == tolerances_digest(Tolerances())


@pytest.mark.parametrize("name", CONSTANTS)
def test_how_densely_and_how_exactly_it_looks_counts(name, monkeypatch):
    before = tolerances_digest.__wrapped__(Tolerances())
    monkeypatch.setattr(tolerances, name, next_to(getattr(tolerances, name)))
    assert tolerances_digest.__wrapped__(Tolerances()) != before


@pytest.mark.parametrize("module", [certificate, motion_checks, verifier])
def test_no_number_of_the_verifier_stands_elsewhere(module):
    for where in (module, verifier):
        numbers = {
            name
            for name, value in vars(where).items()
            if name.isupper() and isinstance(value, int | float)
        }
        assert numbers <= {*CONSTANTS, *OF_DIGESTS}


@pytest.mark.parametrize("other", list(variants(Tolerances())), ids=lambda one: "")
def test_a_certificate_with_other_tolerances_is_none_for_execution(move, other):
    made = verify_motion(RX90, move, other, NOTHING_AROUND)
    assert made.certified
    assert made.belongs_to(move)
    refusal = made.refusal(move, RX90, NOTHING_AROUND)
    assert "other tolerances" in refusal
    assert refusal.endswith("plan again")
    assert made.certifies(move, RX90, NOTHING_AROUND, other), "it says what it was made with"
    forged = replace(made, tolerances=tolerances_digest(Tolerances()))
    assert "another motion" in forged.refusal(move, RX90, NOTHING_AROUND)


def test_a_motion_that_was_verified_as_any_other_is_not_certified_to_cut(move):
    made = verify_motion(RX90, move, obstacles=NOTHING_AROUND)
    assert made.certifies(move, RX90, NOTHING_AROUND)
    assert not made.certifies(move, RX90, NOTHING_AROUND, CuttingTolerances())


def test_a_certificate_without_tolerances_certifies_nothing(move):
    made = verify_motion(RX90, move, obstacles=NOTHING_AROUND)
    for missing in ({"tolerances": ""}, {"robot": ""}):
        old = replace(made, **missing)
        assert old.refusal(move, RX90, NOTHING_AROUND).endswith("plan again")
