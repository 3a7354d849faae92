"""The table of figures: every row has a source, each can be overridden or is refused."""

from pathlib import Path

import numpy as np
import pytest

from rona_core.devices.robots import ROBOTS
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.catalog import figures_of, robot_model
from rona_core.robot.kinematics.parameter_sources import overridden

DOCS = Path(__file__).resolve().parents[4] / "docs" / "algorithms" / "robot"


def table(figures):
    """The table as it stands on the page of the robot."""
    lines = ["| figure | value | trust | source | override |", "|---|---|---|---|---|"]
    for figure in figures:
        values = ", ".join(f"{value:.6g}" for value in figure.values).replace("-", "−")
        trust = f"**{figure.trust}**" if not figure.sourced else figure.trust
        lines.append(
            f"| {figure.name} | {values} {figure.unit} | {trust} | {figure.source} | "
            f"{figure.override} |"
        )
    return "\n".join(lines)


@pytest.mark.parametrize("name", ROBOTS)
def test_each_figure_has_a_source_and_what_nobody_states_is_called_assumed(name):
    figures = {figure.name: figure for figure in figures_of(name)}
    assert all(f.source and f.unit and np.isfinite(f.values).all() for f in figures.values())
    for assumed in ("acceleration", "tool tip on the flange", "home"):
        assert figures[assumed].trust == "assumed"
        assert not figures[assumed].sourced
    for stated in ("base to shoulder", "upper arm", "forearm", "lower limit", "speed"):
        assert figures[stated].sourced
    keys = [figure.key for figure in figures.values() if figure.key]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize(("name", "page"), [("rx90", "rx90.md"), ("ur5", "universal_robots.md")])
def test_the_page_shows_the_table(name, page):
    assert table(figures_of(name)) in (DOCS / page).read_text("utf-8")


@pytest.mark.parametrize("name", ROBOTS)
def test_the_model_is_made_of_the_table(name):
    model, figures = robot_model(name), {f.key: np.array(f.values) for f in figures_of(name)}
    speed = figures["speed_deg_per_s"]
    np.testing.assert_allclose(np.rad2deg(model.speed_rad_per_s), speed, rtol=1e-12)
    np.testing.assert_array_equal(model.acceleration_rad_per_s2, figures["acceleration_rad_per_s2"])
    lower = np.maximum(figures["lower_deg"], figures.get("room_lower_deg", -np.inf))
    upper = np.minimum(figures["upper_deg"], figures.get("room_upper_deg", np.inf))
    np.testing.assert_allclose(np.rad2deg(model.lower_rad), lower, rtol=1e-12)
    np.testing.assert_allclose(np.rad2deg(model.upper_rad), upper, rtol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_keyed_figure_can_be_overridden_and_then_says_so(name):
    for figure in figures_of(name):
        if not figure.key:
            assert figure.override == "another URDF file"
            continue
        value = [v * 1.01 for v in figure.values]
        changed = overridden(figures_of(name), {figure.key: value})
        row = next(f for f in changed if f.key == figure.key)
        assert row.trust == "given"
        assert row.values == pytest.approx(value)
        others = [f for f in changed if f.key != figure.key]
        assert others == [f for f in figures_of(name) if f.key != figure.key]


def test_an_override_reaches_the_model_and_leaves_the_standard_one_alone():
    longer = robot_model("rx90", {"forearm_mm": 650, "acceleration_rad_per_s2": [4.0] * 6})
    assert longer.forward(np.zeros((1, 6)))[0].translation[2] == pytest.approx(1605.0)
    np.testing.assert_array_equal(longer.acceleration_rad_per_s2, 4.0)
    assert robot_model("rx90").arm.forearm_mm == 450.0
    free = robot_model("ur5", {"room_lower_deg": [-360] * 6, "room_upper_deg": [360] * 6})
    assert free.limits.multi_turn().tolist() == [True, True, False, True, True, True]
    assert free.limits.spinning() == (0, 1, 2, 3, 4, 5)
    tip = robot_model("ur10", {"tip_flange_mm": (150.0, 0.0, 60.0)}).T_flange_tip
    np.testing.assert_array_equal(tip.translation, (150.0, 0.0, 60.0))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"forearm": 1.0}, "no figure 'forearm' to override; known are shoulder_mm"),
        ({"forearm_mm": [1.0, 2.0]}, "forearm_mm must be given as a number in mm, not 2 numbers"),
        ({"forearm_mm": "long"}, "forearm_mm must be given as a number in mm, not 'long'"),
        ({"forearm_mm": True}, "forearm_mm must be given as a number"),
        ({"forearm_mm": None}, "forearm_mm must be"),
        ({"forearm_mm": -4.0}, "forearm_mm must be a positive length"),
        ({"speed_deg_per_s": [1.0] * 5}, "speed_deg_per_s must be given as 6 numbers in deg/s"),
        ({"speed_deg_per_s": [1.0, 1.0, 1.0, 1.0, 1.0, np.nan]}, "speed_deg_per_s must be finite"),
        ({"speed_deg_per_s": [0.0] * 6}, "speed and acceleration limits must be positive"),
        ({"upper_deg": [-170.0] * 6}, "each lower joint limit must lie below the upper"),
    ],
)
def test_a_bad_override_is_refused_by_name(overrides, message):
    with pytest.raises(InvalidInputError, match=message):
        robot_model("rx90", overrides)


def test_lengths_of_an_arm_with_a_description_come_from_a_description_alone():
    with pytest.raises(InvalidInputError, match="no figure 'upper_arm_mm'"):
        robot_model("ur5", {"upper_arm_mm": 500.0})
