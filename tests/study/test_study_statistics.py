"""What a study says of its rows, held against samples whose answer is known."""

import re
import tomllib

import numpy as np
import pytest
from scipy import stats

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.overview.bed_risk import read_beds
from rona_core.study.beds import beds_file
from rona_core.study.folder import StudyFolder
from rona_core.study.markdown import study_markdown
from rona_core.study.plan import plan_of
from rona_core.study.report import study_report
from rona_core.study.statistics import (
    Share,
    beyond_limit,
    calibrations,
    effects,
    quantile,
    shares,
)
from rona_ui.cli import main

RNG = np.random.default_rng(7)


def plan(count=60, **given):
    text = given.pop("text", "")
    seeds = {"first": 0, "count": count}
    return plan_of({"seeds": seeds, "until": "maps", **given}, "test", text)


def test_intervals_of_a_quantile_hold_the_true_one_as_often_as_they_say():
    truth = stats.expon.ppf(0.9)
    found = [quantile(RNG.exponential(size=100), 0.9) for _ in range(400)]
    held = np.mean([one.low <= truth <= one.high for one in found])
    assert 0.93 <= held <= 0.99
    assert quantile(np.arange(10.0), 0.95).high is None, "ten are too few for a bound"


def test_a_share_has_the_bounds_of_clopper_and_pearson():
    none = Share("", 0, 3000).estimate
    assert none.low == 0.0
    assert none.high == pytest.approx(1.0 - 0.025 ** (1.0 / 3000))
    some = Share("", 4, 50).estimate
    assert some.low == pytest.approx(stats.beta.ppf(0.025, 4, 47))
    assert some.high == pytest.approx(stats.beta.ppf(0.975, 5, 46))


ROWS = [
    {"completed": True, "coverage_fraction": 1.0, "inner_coverage_fraction": 0.96},
    {"completed": True, "coverage_fraction": 1.0, "inner_coverage_fraction": 0.94},
    {"completed": True, "coverage_fraction": 1.0, "inner_coverage_fraction": 0.0},
    {"completed": False},
]


def test_shares_are_of_all_patients_and_of_stages_that_were_asked_for():
    counts = {one.title: (one.count, one.of) for one in shares(plan(), ROWS)}
    assert counts == {
        "Failed: not to the end of the procedure": (1, 4),
        "No inner map": (2, 4),
        "Both maps cover at least 95% of the region": (1, 4),
        "A limit of any figure broken": (1, 4),
    }
    accepted = ROWS[0] | {"bed_probability": 0.999}
    refused = ROWS[1] | {"bed_probability": 0.98, "bed_reason": "not surely"}
    of_beds = shares(plan(until="implant"), [accepted, refused, *ROWS[2:]])
    assert next(one for one in of_beds if one.title == "No safe bed").count == 3
    inner = FIGURES["inner_coverage_fraction"]
    assert (beyond_limit(ROWS, inner).count, beyond_limit(ROWS, inner).of) == (1, 3)


FACTORS = {
    "SetRobot": {"model": ["rx90", "ur5"]},
    "SetRegion": {"radius_mm": [15.0, 20.0, 25.0]},
    "SetBoneModel": {"kind": ["normal", "sharp"]},
}


def made_rows(study):
    """Rows in which the tool depends on the robot, the cloud on the radius, nothing on the bone."""
    rows = []
    for patient in study.patients():
        levels, noise = patient.levels, RNG.normal(size=3)
        sigma = 0.1 + 0.1 * RNG.random()
        rows.append(
            {"key": patient.key, "seed": patient.seed, "version": patient.version, **levels}
            | {
                "tool_tip_error_mm": 0.3
                + 0.1 * (levels["SetRobot.model"] == "ur5")
                + 0.05 * noise[0]
            }
            | {"surface_rms_mm": 0.01 * levels["SetRegion.radius_mm"] + 0.02 * noise[1]}
            | {"pointer_tip_error_mm": sigma * abs(noise[2]), "pointer_tip_sigma_mm": sigma}
            | {"completed": True}
        )
    return rows


def test_sensitivity_finds_what_was_planted_and_nothing_else():
    study = plan(count=10, factors=FACTORS)
    found, tried = effects(study, made_rows(study))
    assert [(one.factor, one.figure.key) for one in found] == [
        ("SetRegion.radius_mm", "surface_rms_mm"),
        ("SetRobot.model", "tool_tip_error_mm"),
    ]
    assert tried == 3 * 4
    by_radius, by_robot = found
    assert 0.7 < by_radius.share <= 1.0
    assert 0.4 < by_robot.share < 0.9
    assert dict(by_robot.medians)["ur5"] == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_sigma_that_says_too_little_is_seen(factor):
    rows = [
        {"pointer_tip_sigma_mm": sigma, "pointer_tip_error_mm": factor * sigma * abs(z)}
        for sigma, z in zip(RNG.uniform(0.1, 0.3, 300), RNG.normal(size=300), strict=True)
    ]
    (found,) = calibrations(rows)
    assert found.square.low < factor**2 < found.square.high
    assert found.square.high / found.square.low < 1.6
    assert np.mean(found.ratios < factor) == pytest.approx(0.68, abs=0.08)
    for sigma, truth in found.bands:
        assert truth / sigma == pytest.approx(factor, rel=0.25)
    assert found.bands[0][0] < found.bands[1][0] < found.bands[2][0]


TEXT = """
title = "robots <b>& radii</b>"
until = "maps"
seeds = { first = 0, count = 10 }
keep = ["worst 2 of tool_tip_error_mm"]
[factors]
SetRobot.model = ["rx90", "ur5"]
SetRegion.radius_mm = [15.0, 20.0, 25.0]
"""


@pytest.fixture
def folder(tmp_path):
    """The folder of a study with made up rows, of which one patient failed and one is missing."""
    factors = {name: FACTORS[name] for name in ("SetRobot", "SetRegion")}
    study = plan(count=10, factors=factors)
    folder = StudyFolder(tmp_path)
    (tmp_path / "plan.toml").write_text(TEXT)
    rows = made_rows(study)[1:]
    rows[0] |= {"completed": False, "failed_step": "roll", "failure_code": "bad", "reason": "<i>"}
    for row in rows:
        folder.write_row(row)
    worst = max(rows, key=lambda row: row["tool_tip_error_mm"])
    folder.write_session(worst["key"], b"session")
    return folder, worst


def test_the_report_says_all_of_it_on_one_page(folder):
    folder, worst = folder
    page = study_report(folder)
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    assert titles == [
        "Shares",
        "Failures",
        "Figures",
        "Sensitivity",
        "Calibration of predictions",
        "Worst 2: Tool tip error",
    ]
    assert "59 of 60" in page
    assert "Not finished: 1 patients have no row yet." in page
    assert f'<a href="sessions/{worst["key"]}.rona">' in page
    assert "not kept yet" in page
    assert "robots &lt;b&gt;&amp; radii" in page
    assert "<i>" not in page
    assert "<script" not in page
    assert page == study_report(folder), "the same rows give the same bytes"
    assert page.count("<svg") == page.count("</svg>") >= 4


def test_the_report_of_a_study_without_a_row_says_so(folder, tmp_path):
    folder, _ = folder
    for path in tmp_path.glob("patients/*.json"):
        path.unlink()
    page = study_report(folder)
    assert "0 of 60" in page
    assert "Not finished: 60 patients" in page


def test_the_page_in_markdown_has_the_shares_figures_and_the_plan(folder):
    folder, worst = folder
    page = study_markdown(folder)
    assert re.findall(r"^## (.*)$", page, re.MULTILINE) == [
        "Shares",
        "Failures",
        "Figures",
        "Sensitivity",
        "Calibration of predictions",
    ]
    effects = page.partition("## Sensitivity")[2].partition("## ")[0]
    assert "| Factor | Figure | Share | Median by level |" in effects
    assert TEXT.strip() in page
    figure = FIGURES["tool_tip_error_mm"]
    (line,) = [line for line in page.splitlines() if f"`{figure.key}`" in line]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1] == "59"
    assert cells[5] == figure.words(worst["tool_tip_error_mm"])
    assert cells[6] == f"≤ {figure.words(figure.limit)}"


BEDS = """
title = "beds"
until = "implant"
seeds = { first = 0, count = 5 }
keep = ["worst 1 of bed_residual_true_mm"]
"""


def bed_rows(study):
    """Rows of three accepted beds, one that is refused, and a patient without maps."""
    found = [
        {"bed_probability": 0.9995, "bed_residual_true_mm": 1.5},
        {"bed_probability": 0.995, "bed_residual_true_mm": 0.9},
        {"bed_probability": 1.0, "bed_residual_true_mm": 2.5},
        {"bed_probability": 0.7, "bed_residual_true_mm": 1.0, "bed_reason": "not surely"},
        {"completed": False, "failed_step": "maps", "failure_code": "weak", "reason": "nothing"},
    ]
    head = ({"key": p.key, "seed": p.seed, "version": p.version} for p in study.patients())
    return [{**one, "completed": True, **more} for one, more in zip(head, found, strict=True)]


def beds_of(folder_path, text, rows_of=bed_rows):
    (folder_path / "plan.toml").write_text(text)
    folder = StudyFolder(folder_path)
    for row in rows_of(plan_of(tomllib.loads(text), "beds", text)):
        folder.write_row(row)
    return folder


def test_the_beds_of_a_study_are_counted_with_the_settings_that_all_have(tmp_path, capsys):
    found = read_beds(beds_file(beds_of(tmp_path, BEDS)))
    assert found.beds == ((0.9995, 1.5), (0.995, 0.9), (1.0, 2.5))
    assert (found.no_bed, found.failed, found.patients) == (1, 1, 4)
    assert (found.conditions, found.limit_mm) == ({}, 1.0)
    assert (found.first_seed, found.last_seed) == (0, 4)
    assert main(["study", "report", str(tmp_path)]) == 0
    assert "beds.json" in capsys.readouterr().out


def test_the_conditions_of_a_study_are_those_of_its_plan(tmp_path):
    text = BEDS + (
        'skip = ["burr", "caliper"]\n[factors]\nSetWorld.robot_mm = [0.9]\n'
        "StartBedSearch.limit_mm = [0.8]\nSetRegion.radius_mm = [22.0]\n"
    )
    found = read_beds(beds_file(beds_of(tmp_path, text)))
    assert found.limit_mm == 0.8
    assert found.conditions == {
        "world.robot_mm": 0.9,
        "region.radius_mm": 22.0,
        "search.limit_mm": 0.8,
        "no caliper": True,
        "burr not registered": True,
    }


def test_a_patient_without_an_offered_stage_is_not_like_the_others(tmp_path):
    def rows_of(study):
        first, *others = bed_rows(study)
        return [{**first, "references_reason": "no reference point fits"}, *others]

    found = read_beds(beds_file(beds_of(tmp_path, BEDS, rows_of)))
    assert found.beds == ((0.995, 0.9), (1.0, 2.5))
    assert found.failed == 2


@pytest.mark.parametrize(
    "text",
    [
        BEDS.replace("implant", "maps"),
        BEDS + '[factors]\nSetRobot.model = ["rx90", "ur5"]\n',
    ],
)
def test_a_study_without_beds_or_of_several_settings_has_none_to_count(text, tmp_path):
    folder = StudyFolder(tmp_path)
    (tmp_path / "plan.toml").write_text(text)
    for patient in folder.plan().patients():
        head = {"key": patient.key, "seed": patient.seed, "version": patient.version}
        row = {"completed": True, "bed_probability": 1.0, "bed_residual_true_mm": 2.0}
        folder.write_row(head | row)
        folder.write_session(patient.key, b"")
    assert beds_file(folder) is None
