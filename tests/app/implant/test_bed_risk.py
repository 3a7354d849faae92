"""What kept studies say of a bed: counts of patients with the same settings, or none."""

import dataclasses
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from rona_core.app.overview.bed_risk import (
    BY_HAND,
    StudiedBeds,
    bed_risk,
    conditions_of,
    interval,
    kept_beds,
    read_beds,
    risk_among,
    upper_bound,
)
from rona_core.errors import SessionFormatError
from rona_core.session.document import Session

RNG = np.random.default_rng(7)


def study(beds, *, no_bed=0, **conditions):
    return StudiedBeds(
        title="a study",
        version="0.2.0",
        first_seed=0,
        last_seed=len(beds) + no_bed - 1,
        conditions=conditions,
        limit_mm=1.0,
        failed=0,
        no_bed=no_bed,
        beds=tuple(beds),
    )


def bed_at(demo, probability):
    """The bed of the demo session, as if it were accepted at another probability."""
    bed = demo.results.get("bed").value
    chance = replace(bed.placed.chance, probability=probability)
    return replace(bed, placed=replace(bed.placed, chance=chance, screws=()))


@pytest.mark.parametrize(("count", "of"), [(0, 10), (0, 3000), (3, 50), (50, 50), (0, 0)])
def test_bounds_are_those_of_clopper_and_pearson(count, of):
    above = 1.0 if count == of else stats.beta.ppf(0.95, count + 1, of - count)
    assert upper_bound(count, of) == pytest.approx(above)
    if of:
        exact = stats.binomtest(count, of).proportion_ci(0.95, "exact")
        assert interval(count, of) == pytest.approx((exact.low, exact.high))


@pytest.mark.parametrize("share", [0.001, 0.02, 0.3])
def test_the_bound_holds_the_true_share_as_often_as_it_says(share):
    counts = RNG.binomial(200, share, 2000)
    assert np.mean([upper_bound(int(k), 200) >= share for k in counts]) >= 0.94


def test_beds_of_the_same_class_of_probability_are_counted(demo):
    low = [(0.992, 0.9), (0.998, 1.0), (0.9989, 2.0)]
    high = [(0.999, 1.4), (0.9999, 0.7), (1.0, 3.0), (1.0, 2.0)]
    studies = (study(low + high, no_bed=3),)
    at_low = risk_among(studies, bed_at(demo, 0.995), {})
    assert (at_low.beds, at_low.broken, at_low.patients) == (3, 1, 10)
    assert "Of 3 virtual patients like this one with a bed accepted at 99 to 99.9 %" in at_low.words
    at_high = risk_among(studies, bed_at(demo, 0.9995), {})
    assert (at_high.beds, at_high.broken) == (4, 1)
    assert at_high.bound == pytest.approx(stats.beta.ppf(0.95, 2, 3))
    assert "1 had less than 1 mm of bone" in at_high.words


def test_a_refused_bed_has_the_share_of_refused_ones(demo):
    refused = replace(demo.results.get("bed").value, refusal="too thin")
    found = risk_among((study([(0.999, 2.0)] * 30, no_bed=10),), refused, {})
    assert (found.no_bed, found.patients, found.beds) == (10, 40, 0)
    assert "10 had no safe bed either" in found.words


def test_no_number_is_stated_for_settings_that_no_study_has(demo):
    studies = (study([(0.9995, 2.0)] * 100),)
    for conditions, words in (
        ({"devices.probe.name": "1MHz"}, "Probe 1MHz"),
        ({"search.implant": "BCI 601"}, "Implant BCI 601"),
        ({"burr not registered": True}, "burr not registered"),
        ({BY_HAND: True}, BY_HAND),
    ):
        found = risk_among(studies, bed_at(demo, 0.9995), conditions)
        assert found.bound is None
        assert found.beds == found.patients == 0
        assert words in found.words
    assert risk_among((), bed_at(demo, 0.9995), {}).bound is None


def test_the_study_with_the_settings_of_the_session_is_taken(demo):
    hard = study([(0.9995, 0.5)] * 50, **{"world.profile": "hard"})
    easy = study([(0.9995, 2.0)] * 50)
    bed = bed_at(demo, 0.9995)
    assert risk_among((easy, hard), bed, {"world.profile": "hard"}).broken == 50
    assert risk_among((hard, easy), bed, {}).broken == 0


def test_every_setting_of_the_set_up_is_compared_but_the_seed(demo):
    assert conditions_of(demo) == {}
    setup = demo.setup

    def changed(**parts):
        return conditions_of(replace(demo, setup=replace(setup, **parts)))

    devices = setup.devices
    assert changed(seed=5) == {}
    assert changed(region=replace(setup.region, radius_mm=20.0)) == {"region.radius_mm": 20.0}
    assert changed(world=replace(setup.world, profile="hard")) == {"world.profile": "hard"}
    probe = replace(devices.probe, name="1MHz")
    assert changed(devices=replace(devices, probe=probe)) == {"devices.probe.name": "1MHz"}
    moved = replace(devices.robot, base_shift_mm=(1.0, 0.0, 0.0))
    found = changed(devices=replace(devices, robot=moved))
    assert found == {"devices.robot.base_shift_mm": [1.0, 0.0, 0.0]}, "as a file has it"


def test_the_kept_study_speaks_of_the_demo_and_of_no_other_world(demo):
    found = bed_risk(demo)
    assert found.differences == ()
    assert 50 <= found.beds <= found.patients
    assert found.bound < 0.1
    hard = replace(demo, setup=replace(demo.setup, world=replace(demo.setup.world, profile="hard")))
    bed = demo.results.get("bed").value
    other = risk_among(kept_beds(), bed, conditions_of(hard))
    assert other.bound is None
    assert other.differences == ("World hard",)


def test_more_errors_make_a_worse_sentence(demo):
    """True bone that is drawn with twice the error breaks the limit more often."""
    left = RNG.normal(1.8, 0.35, 400)
    bounds = [
        risk_among(
            (study([(0.995, 1.8 + factor * (true_mm - 1.8)) for true_mm in left]),),
            bed_at(demo, 0.995),
            {},
        ).bound
        for factor in (1.0, 2.0)
    ]
    assert 2.0 * bounds[0] < bounds[1]


def test_without_a_bed_nothing_is_said():
    assert bed_risk(Session(name="empty")) is None


def test_a_file_comes_back_as_it_was_and_another_one_is_refused():
    one = study([(0.99, 1.5)], no_bed=2, **{"world.profile": "hard"})
    assert read_beds(json.dumps(dataclasses.asdict(one)).encode()) == one
    for data in (b"", b"[]", b"{}", b'{"beds": [[1]]}'):
        with pytest.raises(SessionFormatError, match=r"beds\.json"):
            read_beds(data)
