"""Plans of studies: the patients that follow from them, and the words of what is refused."""

import pytest

from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import SetProbe, SetRobot
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.errors import InvalidInputError, StorageError
from rona_core.study.plan import plan_of, read_plan

SEEDS = {"first": 5, "count": 3}


def plan(**given):
    return plan_of({"seeds": SEEDS, "until": "pointer", **given}, "test")


def test_crossed_is_every_level_with_every_other_for_every_seed():
    factors = {"SetRobot": {"model": ["rx90", "ur5"]}, "SetProbe": {"front_snr_db": [30.0, 40.0]}}
    patients = plan(factors=factors).patients()
    assert len({p.key for p in patients}) == len(patients) == 3 * 2 * 2
    assert [p.seed for p in patients[:4]] == [5] * 4, "a study that is stopped is balanced"
    assert {tuple(p.levels.values()) for p in patients[:4]} == {
        (robot, snr) for robot in ("rx90", "ur5") for snr in (30.0, 40.0)
    }


def test_levels_become_messages():
    factors = {
        "SetRobot": {"model": ["ur5"], "scan_speed_mm_per_s": [7.0]},
        "SetProbe": {"pitch_mm": [1.5]},
        "SmoothScanPath": {"tolerance_mm": [0.5]},
        "skull": {"center": [[1.0, 2.0, 3.0]]},
    }
    (patient, *_) = plan(factors=factors, until="scan", skip=["gauge"]).patients()
    robot, probe = patient.settings
    assert robot == SetRobot(model="ur5", scan_speed_mm_per_s=7.0)
    assert isinstance(probe, SetProbe)
    assert probe.pitch_mm == 1.5
    sent = [stage.message for stage in patient.stages]
    assert SmoothScanPath(tolerance_mm=0.5) in sent
    assert sent[-1] == StartScan()
    assert "gauge" not in [stage.name for stage in patient.stages]
    assert patient.skull.center == (1.0, 2.0, 3.0)


DRAWN = {
    "SetRegion": {"radius_mm": {"from": 15.0, "to": 30.0}},
    "SetRobot": {"model": ["rx90", "ur5"]},
    "StartRollSearch": {"n_rolls": {"from": 8, "to": 11}},
}


def test_drawn_spreads_evenly_and_a_longer_study_begins_with_the_shorter_one():
    long = plan(design="drawn", factors=DRAWN, seeds={"first": 0, "count": 64}, until="roll")
    short = plan(design="drawn", factors=DRAWN, seeds={"first": 0, "count": 21}, until="roll")
    patients = long.patients()
    assert [p.key for p in patients[:21]] == [p.key for p in short.patients()]
    radii = sorted(p.levels["SetRegion.radius_mm"] for p in patients)
    for place, radius in enumerate(radii):  # one in each of 64 equal parts
        assert 15.0 + 15.0 * place / 64 <= radius < 15.0 + 15.0 * (place + 1) / 64
    robots = [p.levels["SetRobot.model"] for p in patients]
    assert robots.count("rx90") == 32
    rolls = [p.levels["StartRollSearch.n_rolls"] for p in patients]
    assert {rolls.count(n) for n in (8, 9, 10, 11)} == {16}


def test_a_key_follows_from_all_that_the_figures_follow_from(tmp_path):
    keys = {plan(factors={"SetRobot": {"model": ["ur5"]}}).patients()[0].key}
    keys |= {plan(factors={"SetRobot": {"model": ["rx90"]}}).patients()[0].key}
    keys |= {plan().patients()[0].key, plan(until="tool").patients()[0].key}
    keys |= {plan(skip=["gauge"]).patients()[0].key, plan().patients()[1].key}
    skull = tmp_path / "skull.stl"
    for content in ("one", "other"):
        skull.write_text(content)
        keys |= {plan(factors={"skull": {"path": [str(skull)]}}).patients()[0].key}
    assert len(keys) == 8
    assert (
        plan(title="other words", keep=["worst 1 of tool_tip_error_mm"]).patients()[0].key in keys
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"seed": 1}, "seed is not known: a plan has title, until"),
        ({"seeds": 3}, "seeds is { first = 0, count = 100 }"),
        ({"seeds": {"first": 0, "count": 0}}, "count at least 1"),
        ({"until": "moon"}, "no stage 'moon'"),
        ({"skip": ["scan"]}, "skip: one of gauge"),
        ({"skip": "gauge"}, "skip is a list"),
        ({"design": "random"}, "design is crossed or drawn, not 'random'"),
        ({"keep": ["the worst"]}, 'keep: "worst 5 of thickness_rms_mm"'),
        ({"keep": ["worst 5 of beauty"]}, "there is no figure beauty"),
        ({"factors": {"SetRobot": ["ur5"]}}, "SetRobot is followed by a field"),
        ({"factors": {"SetMood": {"x": [1]}}}, "SetMood is no message of a run: one of"),
        ({"factors": {"SetSeed": {"seed": [1]}}}, "SetSeed is no message of a run"),
        ({"factors": {"SetRobot": {"colour": [1]}}}, "SetRobot has no field 'colour': it has"),
        ({"factors": {"SetRobot": {"model": []}}}, "SetRobot.model has no level"),
        ({"factors": {"SetRobot": {"model": "ur5"}}}, "SetRobot.model is a list of levels"),
        ({"factors": {"SetRobot": {"model": ["rx90", "r2d2"]}}}, "SetRobot.model = 'r2d2': "),
        ({"factors": {"SetRegion": {"radius_mm": {"from": 15, "to": 30}}}}, 'design = "drawn"'),
        ({"factors": {"StartScan": {}, "StartBedSearch": {"limit_mm": [1.0]}}}, "no stage up to"),
        ({"factors": {"skull": {"path": ["nowhere.stl"]}}}, "there is no file nowhere.stl"),
    ],
)
def test_what_is_wrong_is_named(given, words):
    with pytest.raises(InvalidInputError) as refused:
        plan(**given)
    assert words in str(refused.value)


def test_a_file_that_is_no_plan_is_named(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text("seeds = {")
    with pytest.raises(InvalidInputError, match=r"plan\.toml: not TOML"):
        read_plan(file)
    with pytest.raises(StorageError, match="it is not there"):
        read_plan(tmp_path / "none.toml")


def test_rules_choose_by_the_sense_of_a_figure():
    worst_error, worst_coverage, best = plan(
        keep=[
            "worst 2 of tool_tip_error_mm",
            "worst 1 of coverage_fraction",
            "best 1 of tool_tip_error_mm",
        ]
    ).keep
    rows = [
        {"key": key, "tool_tip_error_mm": error, "coverage_fraction": coverage}
        for key, error, coverage in (
            ("a", 0.1, 0.9),
            ("b", 0.4, 0.2),
            ("c", 0.3, 1.0),
            ("d", None, None),
        )
    ]
    assert [row["key"] for row in worst_error.chosen(rows)] == ["b", "c"]
    assert [row["key"] for row in worst_coverage.chosen(rows)] == ["b"]
    assert [row["key"] for row in best.chosen(rows)] == ["a"]
