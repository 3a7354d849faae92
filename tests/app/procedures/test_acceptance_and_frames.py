"""Figures beside their limits, and the frame graph."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.overview.acceptance import quality_rows, verdict
from rona_core.app.overview.frame_graph import frame_rows
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import new_workbench
from rona_core.devices.live import LiveState
from rona_core.devices.samples import JointSample, ToolSample, TrackerFrame
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_core.session.memo import Memo

ORDER = ["fail", "review", "pass"]


@settings(max_examples=60, deadline=None)
@given(
    limit=st.floats(0.01, 100.0),
    values=st.tuples(st.floats(0.0, 300.0), st.floats(0.0, 300.0)),
    sense=st.sampled_from(["at most", "at least"]),
)
def test_a_better_value_never_gets_a_worse_verdict(limit, values, sense):
    worse, better = sorted(values, reverse=sense == "at most")
    ranks = [ORDER.index(verdict(value, limit, sense)) for value in (worse, better)]
    assert ranks == sorted(ranks)
    assert verdict(limit, limit, sense) == "pass"


@pytest.mark.parametrize("value", [None, "constant", True])
def test_what_is_no_number_has_no_verdict(value):
    assert verdict(value, 1.0, "at most") == "none"
    assert verdict(0.5, None, "at most") == "none"


def test_a_bias_fails_on_either_side():
    assert verdict(-2.0, 1.0, "at most") == "fail"
    assert verdict(math.nan, 1.0, "at most") == "fail"


def test_every_figure_has_its_row_in_order():
    rows = quality_rows({"surface_rms_mm": 0.7, "unknown": 1.0})
    assert [row.key for row in rows] == list(FIGURES)
    values = {row.key: (row.value, row.verdict) for row in rows}
    assert values.pop("surface_rms_mm") == (0.7, "review")
    assert set(values.values()) == {(None, "none")}


@pytest.fixture(scope="module")
def bench():
    bench = new_workbench(Session())
    bench.run(StartPointerCapture(duration_s=2.0))
    yield bench
    bench.close()


def test_the_pointer_tip_is_a_frame_that_grows_stale(bench):
    rows = {row.name: row for row in frame_rows(bench.session)}
    assert set(rows) == {
        "T_flange_tip",
        "T_flange_probe",
        "T_flange_toolmarker",
        "T_pointermarker_pointertip",
    }
    tip = rows["T_pointermarker_pointertip"]
    wanted = bench.session.results.pointer.value.tip_pointermarker
    np.testing.assert_array_equal(tip.pose @ np.zeros(3), wanted)
    assert tip.stale_reason is None
    session = bench.session
    changed = replace(session, setup=replace(session.setup, seed=session.setup.seed + 1))
    (stale,) = [row for row in frame_rows(changed) if row.source == "pointer"]
    assert "pointer" in stale.stale_reason


def test_what_devices_report_are_frames_too():
    model = robot_model("rx90")
    seen = Pose.from_rotvec((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    samples = (ToolSample("toolmarker", "ok", seen), ToolSample("pointer6d", "out_of_view"))
    live = LiveState(TrackerFrame(0, 0.0, samples), JointSample(0.0, model.home_rad))
    rows = {row.name: row for row in frame_rows(Session(), live) if row.source == "live"}
    assert set(rows) == {"T_base_flange", "T_tracker_toolmarker"}
    assert rows["T_tracker_toolmarker"].pose is seen
    T_base_flange = model.forward(np.asarray(model.home_rad)[None])[0]
    np.testing.assert_array_equal(rows["T_base_flange"].pose.matrix(), T_base_flange.matrix())


def test_figures_are_computed_once_for_a_session_as_it_is(bench, monkeypatch):
    calls = []
    genuine = bench._services.evaluate
    counted = replace(bench._services, evaluate=lambda s, r: calls.append(s) or genuine(s, r))
    monkeypatch.setattr(bench, "_services", counted)
    monkeypatch.setattr(bench, "_judged", Memo(1))
    first = bench.figures()
    first["planted"] = 1  # what a caller does to its copy is its own affair
    again = bench.figures()
    assert len(calls) == 1
    assert "planted" not in again
    assert {**first, "planted": None} == {**again, "planted": None}
    bench.dispatch(SetSeed(8))
    bench.figures()
    assert len(calls) == 2
