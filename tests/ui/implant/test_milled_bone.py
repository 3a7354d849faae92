"""Replay of the milling in the scene: the robot with its spindle, and the bone that disappears."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.implant.view import (
    bone_over_bed,
    milling_duration_s,
    milling_plan_of,
    milling_view,
)
from rona_core.session.document import Session
from rona_ui.panels.layout.bars import milling_words
from rona_ui.presentation.snapshot import replay_duration_s, shown_joints, shown_robot
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.implant import (
    AROUND,
    IMPLANT,
    MILLED,
    POCKET,
    WHOLE,
    BedLayer,
    ImplantLayer,
    MilledBoneLayer,
    around_bed,
)
from tests.ui.implant.test_implant_layers import drawn, looked_at

STEP = ViewState(step="implant", hidden=frozenset())
HALF, DONE = (replace(STEP, milling_cursor=share) for share in (0.5, 1.0))


@pytest.fixture(scope="module")
def milling(demo):
    return milling_view(demo)


def test_more_bone_is_milled_the_later_it_is_and_the_rest_is_whole(demo, milling):
    half, done = (
        drawn(MilledBoneLayer, looked_at(demo, milling, view)).drawn for view in (HALF, DONE)
    )
    assert 0 < len(half[MILLED].faces) < len(done[MILLED].faces)
    sums = {len(nodes[MILLED].faces) + len(nodes[WHOLE].faces) for nodes in (half, done)}
    assert len(sums) == 1
    heights = (milling.placed.T_base_bed.inv() @ done[MILLED].vertices)[:, 2]
    assert heights.min() == pytest.approx(-milling.bed.depth_mm.max(), abs=0.05)


def test_the_surface_round_the_bed_leaves_no_gap(demo, milling):
    bone, outer = bone_over_bed(demo), demo.results.maps.value.outer
    T_bed_base = milling.placed.T_base_bed.inv()
    around = around_bed(outer, bone, milling.placed.T_base_bed)
    used = (T_bed_base @ around.vertices)[around.faces]
    low, high = used.min(axis=1), used.max(axis=1)
    assert not (
        (low[:, 0] > bone.x_mm[0] + 2.0)
        & (high[:, 0] < bone.x_mm[-1] - 2.0)
        & (low[:, 1] > bone.y_mm[0] + 2.0)
        & (high[:, 1] < bone.y_mm[-1] - 2.0)
    ).any()  # nothing over the bed
    beside = (high[:, 0] > bone.x_mm[0]) & (low[:, 0] < bone.x_mm[0])
    assert beside.any()  # cells that go across the edge are there


def test_without_a_replay_bed_and_implant_are_seen_and_with_one_they_are_not(demo, milling):
    for layer, node in ((ImplantLayer, IMPLANT), (BedLayer, POCKET)):
        assert drawn(layer, looked_at(demo, milling, STEP)).seen[node]
        assert not drawn(layer, looked_at(demo, milling, HALF)).seen[node]
    assert not drawn(MilledBoneLayer, looked_at(demo, milling, STEP)).seen[AROUND]
    elsewhere = replace(HALF, step="maps")
    assert not drawn(MilledBoneLayer, looked_at(demo, milling, elsewhere)).seen[AROUND]


def test_the_robot_holds_the_spindle_where_the_plan_says(demo, milling):
    new = looked_at(demo, milling, HALF)
    motion, q_rad = milling_plan_of(demo).trajectory, shown_joints(new)
    time_s = 0.5 * motion.times_s[-1]
    np.testing.assert_allclose(
        q_rad, [np.interp(time_s, motion.times_s, q) for q in motion.qs_rad.T]
    )
    assert shown_robot(new).tool.spindle is not None
    assert shown_robot(looked_at(demo, milling, STEP)).tool.spindle is None
    turning = JobStatus("1", "StartBurrCapture", "running", 0.1)
    assert shown_robot(replace(looked_at(demo), job=turning)).tool.spindle is not None
    done = replace(turning, state="done")
    assert shown_robot(replace(looked_at(demo), job=done)).tool.spindle is None


def test_the_replay_tells_time_and_layer(demo, milling):
    new = looked_at(demo, milling, DONE)
    duration_s = replay_duration_s(demo, DONE)
    assert duration_s == milling_duration_s(demo)
    n = int(milling.path.layers[-1]) + 1
    minutes, seconds = divmod(round(duration_s), 60)
    clock = f"{minutes}:{seconds:02d}"
    assert milling_words(new, duration_s).startswith(f"{clock} of {clock} min, layer {n} of {n}")
    assert replay_duration_s(Session(), DONE) is None  # no plan: no replay
