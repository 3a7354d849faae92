"""Error budget: predicted causes beside those in truth, which add up to the error of the map."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.declarations.figures import FIGURES, OUTER_CAUSES, THICKNESS_CAUSES
from rona_core.app.steps.maps.error_budget import OUTER, THICKNESS, error_budgets
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.compose import build_virtual_rig, evaluate_virtual
from rona_core.evaluation.map_metrics import cells, outer_errors_mm
from rona_core.evaluation.scan_metrics import WRONG_MM, true_probe_poses
from rona_core.evaluation.truth import truth_of
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at
from rona_core.virtual.acoustics.medium import bone_medium, true_bone
from tests.scenes import demo_parts

KEYS = tuple(one.key for one in (*OUTER_CAUSES, *THICKNESS_CAUSES))


@pytest.fixture(scope="module")
def figures():
    return demo_parts.figures()


def test_every_cause_is_in_one_line_and_every_line_has_its_truth(demo, figures):
    accuracy = map_accuracy(demo)
    for part, groups in ((accuracy.outer, OUTER), (accuracy.thickness, THICKNESS)):
        named = [cause for group in groups for cause in group.causes]
        assert sorted(named) == sorted(row.cause for row in part.budget)
    assert {group.key for groups in (OUTER, THICKNESS) for group in groups} == {*KEYS, ""}
    budgets = error_budgets(accuracy, figures)
    assert [budget.name for budget in budgets] == ["Outer boundary", "Thickness"]
    known = [FIGURES[key].title for key in KEYS]
    for budget in budgets:
        for line in budget.lines:
            assert (line.true_mm is not None) == (line.title in known), line
    assert all(line.true_mm is None for b in error_budgets(accuracy, {}) for line in b.lines)


def test_no_cause_is_ten_times_what_was_predicted(demo, figures):
    for budget in error_budgets(map_accuracy(demo), figures):
        for line in budget.lines:
            if line.true_mm is not None:
                assert line.true_mm < 5.0 * line.predicted_mm + 0.02, line


def test_what_links_and_head_did_is_no_error_of_the_echoes(demo, figures):
    maps = demo.results.maps.value
    truth = truth_of(demo, build_virtual_rig(demo.setup).scene)
    errors = outer_errors_mm(cells(maps.outer), truth, False)
    besides = np.sqrt(np.std(errors) ** 2 - figures["outer_by_sampling_mm"] ** 2)
    # with links left out, or of the other sign, what is left is 0.8 of it and more
    assert figures["outer_by_sampling_mm"] < 0.6 * np.std(errors)
    assert besides < figures["outer_by_links_mm"] + figures["outer_by_head_mm"]


def test_an_outer_boundary_that_is_moved_as_a_whole_counts_with_the_probe(demo, figures):
    made = demo.results.maps
    normal = made.value.outer.T_base_map.rotation[:, 2]
    points = made.value.outer_points_base + 0.5 * normal
    outer = replace(made.value.outer, height_mm=made.value.outer.height_mm + 0.5)
    higher = replace(made.value, outer=outer, outer_points_base=points)
    results = replace(demo.results, maps=replace(made, value=higher))
    moved = evaluate_virtual(replace(demo, results=results), build_virtual_rig(demo.setup))
    assert abs(moved["outer_by_probe_mm"] - figures["outer_by_probe_mm"]) > 0.4
    assert moved["outer_by_sampling_mm"] == pytest.approx(figures["outer_by_sampling_mm"], abs=0.03)


def test_what_all_echoes_have_in_common_counts_with_the_mean_speed(demo, figures):
    """Both together are the mean error of the thickness of the A-scans."""
    found, maps = demo.results.detection.value, demo.results.maps.value
    n = len(found)
    truth = truth_of(demo, build_virtual_rig(demo.setup).scene)
    world = truth.scene.world
    depth = true_bone(true_probe_poses(demo.captures.scan, truth), truth.scene, bone_medium(world))[
        1
    ]
    taken = speed_at(demo.results.speed.value, maps.outer_points_base[:n])[0]
    errors = found.thickness_mm * taken / found.sound_speed_mm_per_us - depth
    sure = maps.inner_used[:n] & (np.abs(errors) < WRONG_MM)
    assert figures["thickness_by_speed_mm"] == pytest.approx(abs(errors[sure].mean()), abs=0.02)


@pytest.mark.slow
def test_echoes_that_all_come_late_alike_are_no_scatter_of_each(demo, figures):
    found = demo.results.detection
    speeds = []
    for late_mm in (-0.1, 0.1):
        late = replace(found.value, thickness_mm=found.value.thickness_mm + late_mm)
        results = replace(demo.results, detection=replace(found, value=late))
        later = evaluate_virtual(replace(demo, results=results), build_virtual_rig(demo.setup))
        speeds.append(later["thickness_by_speed_mm"])
        echo = "thickness_by_echo_mm"
        assert later[echo] == pytest.approx(figures[echo], abs=0.01)
    assert max(speeds) > figures["thickness_by_speed_mm"] + 0.05


def test_the_lines_of_a_budget_hold_each_cause_once(demo):
    accuracy = map_accuracy(demo)
    outer, bone = error_budgets(accuracy, {})
    for part, budget in ((accuracy.outer, outer), (accuracy.thickness, bone)):
        together = sum(line.predicted_mm**2 for line in budget.lines)
        assert together == pytest.approx(sum(row.sigma_mm**2 for row in part.budget))
    rows = {row.cause: row for row in accuracy.thickness.budget}
    lines = {line.title: line.predicted_mm for line in bone.lines}
    timing, speed = rows["time of flight"], rows["speed of sound of the patient"]
    assert lines["Each echo: timing"] == pytest.approx(timing.own_mm)
    alike = np.hypot(speed.sigma_mm, timing.shared_mm)
    assert lines["Speed of sound, all echoes alike"] == pytest.approx(alike)
    assert timing.shared_mm > 0.0


def test_without_maps_no_cause_is_known():
    empty = Session()
    figures = evaluate_virtual(empty, build_virtual_rig(empty.setup))
    assert not any(figures[key] for key in KEYS)
