"""A robot that errs more than assumed contradicts its own registration, and hardly any other does.

The registration's expected error stands on what robot and tracker are stated to be: it is called
assumed, and residuals or landmarks that contradict it take the word good away.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.report.report import session_report
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.scan.landmarks.messages import StartLandmarkCapture
from rona_core.app.steps.scan.landmarks.step import verification
from rona_core.app.steps.scan.landmarks.view import landmark_report
from rona_core.app.steps.setup.messages import SetRobot, SetSeed, SetTracker, SetWorld
from rona_core.app.steps.tool.calibration_view import calibration_view
from rona_core.app.steps.tool.derivation import tool_dwells
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.calibration.hand_eye.robot_accuracy import (
    FALSE_ALARM,
    check_robot_accuracy,
    score_of_links,
)
from rona_core.calibration.hand_eye.tool_registration import register_tool
from rona_core.calibration.tracking_error import LearnedField, TrackerErrorField
from rona_core.compose import new_workbench
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import link_errors
from rona_core.session.document import Session
from tests.scenes import demo_parts

STATED_MM, TURN_DEG, SHIFT_MM = 0.35, 0.02, 0.05
DRAWS = 12


@pytest.fixture(scope="module")
def motion():
    """Return poses of the tip and errors of links (n, 6, 36) along the tool motion of the demo."""
    demo = demo_parts.demo()
    model = robot_model(demo.setup.devices.robot.model)
    qs_rad, _, _ = tool_dwells(demo.captures.tool, model)
    links = link_errors(model, qs_rad, model.T_flange_tip, STATED_MM)
    return model.forward(qs_rad) @ model.T_flange_tip, links, demo.results.tool.value


def checked(motion, ratio, seed):
    """Return the test of a robot that errs ``ratio`` times as much as stated."""
    tips, links, made = motion
    rng = np.random.default_rng(seed)
    off = ratio * links @ rng.standard_normal(links.shape[2])
    turns = off[:, :3] + np.deg2rad(TURN_DEG) / 3.0**0.5 * rng.standard_normal((len(tips), 3))
    shifts = off[:, 3:] + SHIFT_MM / 3.0**0.5 * rng.standard_normal((len(tips), 3))
    true = Poses(
        Rotation.from_rotvec(turns).as_matrix() @ tips.rotations, tips.translations + shifts
    )
    seen = made.T_base_tracker.inv() @ true @ made.T_toolmarker_tip.inv()
    found = register_tool(tips, seen)
    none = LearnedField(replace(TrackerErrorField(), total_mm=0.0))
    return check_robot_accuracy(found, tips, seen, links, none)


@pytest.mark.ci
@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("ratio", "least", "most"), [(1.0, 0.0, 0.17), (2.0, 0.6, 1.0), (3.0, 0.9, 1)]
)
def test_residuals_show_how_much_the_robot_errs(motion, ratio, least, most):
    tests = [checked(motion, ratio, seed) for seed in range(DRAWS)]
    assert least <= np.mean([test.contradicted for test in tests]) <= most
    assert np.median([test.ratio for test in tests]) == pytest.approx(ratio, rel=0.3, abs=0.1)


def test_of_a_robot_without_stated_errors_or_of_few_poses_nothing_is_said(motion):
    tips, links, made = motion
    field = LearnedField(TrackerErrorField())
    seen = made.T_base_tracker.inv() @ tips @ made.T_toolmarker_tip.inv()
    found = register_tool(tips, seen)
    assert check_robot_accuracy(found, tips, seen, 0.0 * links, field) is None
    few = replace(found, used=np.arange(len(tips)) < 8)
    assert check_robot_accuracy(few, tips, seen, links, field) is None


@pytest.mark.slow
def test_false_alarms_are_as_seldom_as_stated_whatever_the_links_and_the_rest_are():
    """Residuals drawn from the assumption itself: one per cent of them contradict it."""
    rng = np.random.default_rng(7)
    alarms, ratios = [], []
    for _ in range(6):
        by_links = rng.standard_normal((15, 36)) * np.geomspace(1.0, 0.05, 36)
        root = rng.standard_normal((15, 15))
        rest = root @ root.T * 0.05 + 0.1 * np.eye(15)
        factor = np.linalg.cholesky(rest)
        for _ in range(400):
            noise = factor @ rng.standard_normal(15)
            draw = by_links @ rng.standard_normal(36)
            alarms.append(score_of_links(noise + draw, by_links, rest).contradicted)
            ratios.append(score_of_links(noise + 3.0 * draw, by_links, rest).ratio)
    assert 0.3 * FALSE_ALARM < np.mean(alarms) < 2.0 * FALSE_ALARM
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(3.0, rel=0.1)


@pytest.fixture(scope="module")
def contradicted():
    """Return a session in a world whose robot errs by three times what is assumed."""
    bench = new_workbench(Session(name="robot errs"))
    for message in (
        SetSeed(61_004),
        SetWorld(profile="realistic", robot_mm=3.0 * STATED_MM),
        SetTracker(profile="vega"),
        SetRobot(model="ur5"),
    ):
        bench.dispatch(message)
    for step in (StartToolCapture(), StartPointerCapture(), StartLandmarkCapture()):
        bench.run(step)
    yield bench.session
    bench.close()


@pytest.mark.slow
def test_a_contradicted_registration_is_not_good_wherever_it_is_shown(contradicted):
    made = contradicted.results.tool.value
    assert made.verdict == "weak"
    (reason,) = made.reasons
    assert "0.35 mm are assumed" in reason
    assert "register again" in reason
    view = calibration_view(contradicted, "tool")
    title = FIGURES["tracker_registration_sigma_mm"].title
    assert title in [one.title for one in view.expected]
    rows = {row.key: row for row in quality_rows({}, contradicted)}
    row = rows["tracker_registration_sigma_mm"]
    assert row.title == title == "Registration, assumed"
    assert (row.verdict, row.reason) == ("review", reason)
    page = session_report(contradicted, {}, None)
    assert title in page
    assert "0.35 mm are assumed" in page


@pytest.mark.ci
def test_landmarks_that_contradict_the_robot_are_a_warning_and_no_pass(contradicted):
    check = contradicted.results.get("landmarks").value
    assert "the distances of the landmarks vary with the posture" in check.contradiction
    rows = {row.key: row for row in quality_rows({"landmark_distance_mm": 0.1}, contradicted)}
    assert rows["landmark_distance_mm"].verdict in ("review", "fail")
    assert landmark_report(contradicted).contradicted
    if check.verdict == "pass":
        assert check.contradiction in verification(contradicted).sentence
