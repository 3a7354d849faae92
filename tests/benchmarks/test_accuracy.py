"""The suite of the maps: medians, what is judged near and far, and what a budget's share is."""

import numpy as np
import pytest

from benchmarks.suites.accuracy import accuracy, gap_fusion, judged_maps, map_cost
from rona_core.app.steps.maps.error_budget import OUTER, THICKNESS
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.truth import truth_of
from rona_core.session.document import Session
from tests.scenes import demo_parts


@pytest.fixture(scope="module")
def judged():
    session = demo_parts.demo()
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    return {(one.quantity, one.part): one for one in judged_maps.judge(session, truth, 0)}


@pytest.mark.slow
def test_every_cell_is_judged_once_by_its_distance_to_a_sample(judged):
    for name in ("outer same robot", "thickness"):
        parts = [one for (quantity, _), one in judged.items() if quantity.startswith(f"{name}, ")]
        errors = np.concatenate([part.errors for part in parts])
        assert abs(errors.mean()) < 1e-12  # less the mean of the map, and none is left out
        assert (np.concatenate([part.sigmas for part in parts]) > 0.0).all()
    assert len(judged["fused same robot, over 2.5 mm from a sample", "local"].errors) > 100
    assert not len(judged["outer same robot, over 2.5 mm from a sample", "local"].errors)


@pytest.mark.slow
def test_larger_patches_are_fewer(judged):
    counts = [
        len(judged[f"drawn thickness, patches of {size} mm", "whole"].errors)
        for size in (5, 10, 20)
    ]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 0


def test_patches_are_full_and_apart():
    known = np.zeros((23, 17), dtype=bool)
    known[:12, :10] = True
    found = list(judged_maps._squares(known, 5))
    assert len(found) == 4  # the third row of squares has two of five lines
    assert sum(found).max() == 1


def test_medians_have_the_goal_of_their_world():
    made = [(Session(), {"outer_same_robot_rms_mm": size}) for size in (0.01, 0.04, 0.2)]
    made.append((Session(), {"outer_same_robot_rms_mm": None}))
    found = {metric.name: metric for metric in accuracy._sizes("nominal", made)}
    metric = found["nominal: outer_same_robot_rms_mm (median of 3)"]
    assert (metric.value, metric.goal, metric.holds) == (0.04, 0.05, True)
    assert found["nominal: inner_same_robot_rms_mm (median of 0)"].holds is None


@pytest.mark.slow
def test_fusion_is_held_against_what_no_session_can_know():
    session = demo_parts.demo()
    found = gap_fusion.fusion_figures(
        session, truth_of(session, build_virtual_rig(session.setup).scene)
    )
    assert found is not None
    for errors in (found.covered, found.gap):
        assert errors["exact points"] < errors["true motion"] < 1.05 * errors["fused"]
        assert errors["exact points"] < 0.8 * errors["alone"]
    assert 0.05 < found.slide_stated_mm < 0.3


def test_a_survey_lies_in_rows_on_a_dome():
    samples = map_cost.survey(0.6)
    assert len(np.unique(samples[:, 0])) == map_cost.SIDE_MM / map_cost.PITCH_MM
    assert np.ptp(np.diff(np.unique(samples[:, 1]))) < 1e-9
    assert samples[:, 2].max() < 1.0


def test_a_budget_of_few_numbers_is_held_to_what_honest_predictions_keep():
    sizes = np.r_[np.full(15, 0.1), np.full(5, 0.2)]
    drawn = sizes * np.random.default_rng(0).normal(size=(100_000, 20))
    shares = np.sqrt(np.mean(sizes**2) / np.mean(drawn**2, axis=1))
    least, most = accuracy.budget_goal(list(sizes), 20)
    assert np.mean((shares >= least) & (shares <= most)) == pytest.approx(0.95, abs=0.01)
    assert accuracy.budget_goal(list(sizes), 10)[1] > most  # two skulls of each patient
    assert accuracy.budget_goal([0.1] * 2000, 2000) == (0.8, 1.2)
    assert accuracy.budget_goal(list(sizes), None) == (0.8, 1.2)


def test_causes_that_are_one_number_a_session_are_titles_of_the_budget():
    assert set(accuracy.ONE_A_SESSION) < {group.title for group in (*OUTER, *THICKNESS)}
