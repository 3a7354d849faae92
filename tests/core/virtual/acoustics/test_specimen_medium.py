from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.setup.messages import SetBoneModel, SetWorld
from rona_core.compose import build_virtual_rig
from rona_core.devices.world_settings import NOMINAL_WORLD
from rona_core.errors import InvalidInputError
from rona_core.session.document import Session
from rona_core.session.specimen import BoneChoice
from rona_core.virtual.acoustics.medium import (
    LOCAL_SD,
    MEDIA,
    PATIENT_SD,
    bone_medium,
    patient_speed_factor,
)
from rona_core.virtual.world.world import draw_world


@pytest.mark.parametrize("kind", list(MEDIA))
def test_without_a_speed_of_its_own_it_is_the_named_medium(kind):
    choice = BoneChoice(kind, own_speed=False)
    assert bone_medium(draw_world(NOMINAL_WORLD, choice, 5)) == MEDIA[kind]


def test_patients_differ_by_what_is_published_and_one_seed_is_one_patient():
    factors = np.array([patient_speed_factor(seed) for seed in range(600)])
    assert factors.mean() == pytest.approx(1.0, abs=0.004)
    assert factors.std() == pytest.approx(PATIENT_SD, rel=0.12)
    assert patient_speed_factor(4) == patient_speed_factor(4)
    assert np.abs(factors - 1.0).max() <= 2.5 * PATIENT_SD + 1e-12


def test_table_and_diploe_share_the_patients_factor_and_nothing_else_changes():
    found = bone_medium(draw_world(NOMINAL_WORLD, BoneChoice("hard"), 7))
    factor = patient_speed_factor(7)
    for name in ("table", "diploe"):
        nominal = getattr(MEDIA["hard"], name)
        faster = replace(nominal, speed_mm_per_us=factor * nominal.speed_mm_per_us)
        assert getattr(found, name) == faster
    assert found.local_speed_sd == LOCAL_SD
    back = replace(
        found, table=MEDIA["hard"].table, diploe=MEDIA["hard"].diploe, local_speed_sd=0.0
    )
    assert back == MEDIA["hard"]


def test_hard_bone_scatters_two_and_a_half_times_as_much_and_has_no_ramp():
    assert MEDIA["hard"].speckle == pytest.approx(2.5 * MEDIA["normal"].speckle)
    assert MEDIA["hard"].ramp_mm == MEDIA["sharp"].ramp_mm == 0.0


def test_an_unknown_kind_of_bone_is_refused():
    with pytest.raises(InvalidInputError, match="normal, sharp, hard, not 'soft'"):
        BoneChoice("soft")


def test_the_choice_reaches_the_virtual_probe_and_makes_its_scan_another():
    heard = {}
    for kind in ("normal", "hard"):
        nominal = handle(SetWorld("nominal"), Session(name="bone"))
        session = handle(SetBoneModel(kind, own_speed=False), nominal)
        assert session.setup.bone == BoneChoice(kind, own_speed=False)
        rig = build_virtual_rig(session.setup)
        heard[kind] = rig.probe.medium
        rig.close()
    assert heard == {kind: MEDIA[kind] for kind in heard}
    digests = {
        capture_setup_digest(kind, handle(SetBoneModel(bone), Session(name="bone")))
        for kind in ("scan",)
        for bone in ("normal", "hard")
    }
    assert len(digests) == 2
    touched = [
        capture_setup_digest("surface", handle(SetBoneModel(bone), Session(name="bone")))
        for bone in ("normal", "hard")
    ]
    assert touched[0] == touched[1]  # a pointer does not hear the bone
