"""The step from table to diploe is no inner boundary: something is behind it, here or beside."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.ultrasound.detection.detect import nominal_bone
from rona_core.ultrasound.detection.single.inner_echo import (
    Candidates,
    bone_filter,
    bone_gate_us,
    through_bank,
)
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.detection.spatial.detectability import spread_along_interface
from rona_core.ultrasound.detection.spatial.neighbours import line_links, scan_links
from rona_core.ultrasound.detection.spatial.track_before_detect import (
    STACK_SURE,
    loudest_repeat,
)
from rona_core.ultrasound.probe.probe_model import probe_model
from tests.scenes.bone_surveys import detected, fired_again, stood_on

PROBE = probe_model("2.25MHz")
SIDE = 9
PLACES = np.stack(np.meshgrid(*[2.0 * np.arange(SIDE)] * 2, [0.0]), axis=-1).reshape(-1, 3)
LINKS = scan_links(PLACES, SIDE**2)
NEAR = PLACES[:, 0] < 10.0  # the inner boundary is seen behind the step here, and not further on
SURE_NO_MORE = (
    0.15  # from here on, `candidate_selection.DOUBT` leaves less than what counts as sure
)
WRONG_MM = 1.0


def candidates(levels):
    columns = {f.name: np.zeros(np.shape(levels)) for f in fields(Candidates)}
    columns["exists"] = np.ones(np.shape(levels), dtype=np.bool_)
    return Candidates(**{**columns, "level": np.asarray(levels, dtype=np.float64)})


def along(behind, depth, levels=None, links=LINKS):
    levels = np.full(np.shape(depth), 0.4) if levels is None else levels
    return spread_along_interface(
        np.asarray(behind), np.asarray(depth), candidates(levels), links, PROBE
    )


def step(depth_mm=2.1):
    """One echo in each A-scan, and how sure a boundary lies behind it in a part of them."""
    depth = np.full((SIDE**2, 1), depth_mm)
    return np.where(NEAR, STACK_SURE, 0.0)[:, None], depth


def test_an_interface_that_sound_passes_here_is_not_the_last_one_beside():
    behind, depth = step()
    found = along(behind, depth)
    assert found[~NEAR & (PLACES[:, 0] < 16.0)].min() > SURE_NO_MORE
    assert (behind[~NEAR] == 0.0).all()  # which no A-scan knew by itself


def test_another_interface_is_another_one():
    behind, depth = step()
    depth[~NEAR] = 3.0
    assert (along(behind, depth)[~NEAR] == 0.0).all()


def test_a_fainter_echo_of_the_same_depth_is_not_this_interface():
    behind, depth = step()
    levels = np.where(NEAR, 0.1, 0.4)[:, None]
    assert (along(behind, depth, levels)[~NEAR] == 0.0).all()


def test_what_is_deeper_than_any_outer_table_is_left_alone():
    behind, depth = step(0.5 * PROBE.max_thickness_mm)
    np.testing.assert_array_equal(along(behind, depth), behind)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_nothing_is_doubted_less_than_before_and_nothing_where_nothing_is_behind(seed):
    random = np.random.default_rng(seed)
    depth = random.uniform(1.3, 12.0, (SIDE**2, 3))
    behind = random.uniform(0.0, STACK_SURE, depth.shape)
    levels = random.uniform(0.1, 1.0, depth.shape)
    found = along(behind, depth, levels)
    assert (found >= behind).all()
    assert found.max() <= STACK_SURE
    assert (along(np.zeros(depth.shape), depth, levels) == 0.0).all()


@pytest.mark.sweep(2)
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
@pytest.mark.parametrize("name", ["2.25MHz", "1MHz"])
@pytest.mark.parametrize("share", [1.0, 1.5, 2.0])
def test_the_side_lobes_of_a_nominal_echo_are_no_boundary_behind_it(name, excitation, share):
    probe, bone = probe_model(name), nominal_bone()
    template, depth = block_template(probe, excitation), share * probe.min_thickness_mm
    delay = template.shift(np.array([-2.0 * depth / bone.speed_mm_per_us]))
    first, last = (int(t / template.step_us) for t in bone_gate_us(probe, bone))
    echo = bone_filter(template, bone, depth) * delay
    level = np.abs(through_bank(echo, template, bone, first, last)[0][0])
    depths = np.arange(first, last + 1) * template.step_us * bone.speed_mm_per_us / 2.0
    behind = depths > depth + 3.0
    assert (1.5 * level[behind] / level.max() < loudest_repeat(depth, depths[behind])).all()


def test_no_scans_have_nothing_behind():
    assert along(np.zeros((0, 4)), np.zeros((0, 4)), links=line_links(0)).shape == (0, 4)


@pytest.mark.parametrize("kind", ["hard", "sharp"])
def test_the_step_is_not_kept_where_the_inner_echo_of_a_patch_drowns(kind):
    """A patient of whose 7.3 mm a fifth and more of what was kept said 2.1, surely."""
    survey = stood_on(20_000, radius_mm=14.0, lines_mm=2.0)
    scene = fired_again(survey, kind)
    found = detected(survey, scene)
    error = found.thickness_mm - scene.bone_us * found.sound_speed_mm_per_us / 2.0
    wrong, ok = np.abs(error) > WRONG_MM, found.inner_ok
    assert scene.thickness_mm.min() > 5.0  # so that 2 mm is never the inner boundary
    assert (wrong & (found.thickness_mm < 3.0)).mean() > 0.1  # which it still is the best guess of
    assert wrong[ok].mean() <= 0.02
    assert ok.mean() > 0.2
