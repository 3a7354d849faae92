"""The probe in the hand: calibrated, scanned and mapped with and without the robot."""

import numpy as np
import pytest

from rona_core.app.declarations.figures import HANDHELD
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.runtime.session_step import Undo, replay
from rona_core.app.steps.handheld.derivation import DELAY
from rona_core.app.steps.handheld.messages import (
    CalibrateHandheldProbe,
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.setup.messages import (
    SetSeed,
    SetToolVisible,
    SetTracker,
    SetUseBaseMarker,
    SetWorld,
)
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.errors import DegenerateGeometryError, InvalidInputError, StepBlockedError
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session

QUICK = StartHandheldScan(duration_s=30.0, rate_hz=20.0, spacing_mm=3.0)
SONO_KEYS = tuple(one.key for one in HANDHELD)


@pytest.fixture(scope="module")
def by_hand():
    """A scan by hand with nothing else done before."""
    bench = new_workbench(Session())
    bench.dispatch(SetSeed(2))
    bench.dispatch(SetWorld("nominal"))
    for activity in (StartHandheldCalibration(), QUICK, StartHandheldMapping()):
        bench.run(activity)
    yield bench
    bench.close()


@pytest.mark.ci
def test_without_the_robot_it_maps_both_boundaries(by_hand):
    session, figures = by_hand.session, by_hand.figures()
    assert session.results.tool is None
    assert session.results.sono.value.verdict == "good"
    made = session.results.sono_maps.value
    assert (made.frame, made.n_scans) == ("basemarker", 600)
    assert made.n_posed > 0.95 * made.n_scans
    assert "no robot" in made.sentence
    assert made.maps.cloud_fit is None
    assert figures["sono_face_error_mm"] < 0.5
    assert figures["sono_axis_error_deg"] < 0.4
    assert figures["sono_outer_rms_mm"] < 0.7
    assert figures["sono_thickness_rms_mm"] < 0.5
    assert figures["sono_inner_rms_mm"] < 1.0
    assert figures["sono_coverage_fraction"] > 0.95
    assert figures["sono_inner_coverage_fraction"] > 0.5
    assert figures["outer_rms_mm"] is None


@pytest.mark.slow
def test_it_follows_from_the_captures_and_survives_a_file(by_hand, tmp_path):
    again = replay(by_hand.session)
    assert [row.result for row in again] == ["sono", "sono_detection", "sono_maps"]
    assert all(row.same for row in again)
    path = tmp_path / "hand.rona"
    save_session(by_hand.session, path)
    loaded = load_session(path)
    assert all(row.same for row in replay(loaded))
    assert (
        loaded.captures.sono_scan.scans.rf.shape
        == by_hand.session.captures.sono_scan.scans.rf.shape
    )


@pytest.mark.ci
def test_what_has_changed_makes_it_stale_and_undo_brings_it_back(by_hand):
    names = ("sono", "sono_detection", "sono_maps")
    assert [stale_reason(name, by_hand.session) for name in names] == [None] * 3
    by_hand.dispatch(SetUseBaseMarker(use_base_marker=False))
    assert stale_reason("sono_maps", by_hand.session) is None  # nobody moved the tracker
    by_hand.dispatch(Undo())
    by_hand.dispatch(SetSeed(3))
    assert all(stale_reason(name, by_hand.session) for name in names)
    by_hand.dispatch(Undo())
    assert [stale_reason(name, by_hand.session) for name in names] == [None] * 3


def test_an_order_that_makes_no_sense_is_blocked():
    bench = new_workbench(Session())
    try:
        with pytest.raises(StepBlockedError, match="calibrate the SonoPointer"):
            bench.run(StartHandheldScan())
        with pytest.raises(StepBlockedError, match="pivot the SonoPointer"):
            bench.dispatch(CalibrateHandheldProbe())
        with pytest.raises(StepBlockedError, match="scan by hand"):
            bench.run(StartHandheldMapping())
        with pytest.raises(DegenerateGeometryError, match="from end to end"):
            bench.run(StartHandheldCalibration(half_turn_deg=15.0))
        kept = bench.session.captures
        assert kept.sono_pivot.ordinal + 1 == kept.sono_spin.ordinal  # nothing measured is lost
        assert bench.session.results.sono is None
    finally:
        bench.close()


@pytest.mark.ci
def test_with_a_covered_base_marker_and_no_robot_there_is_no_reference(by_hand):
    bench = new_workbench(by_hand.session)
    try:
        bench.dispatch(SetToolVisible("basemarker", False))
        bench.run(StartHandheldScan(duration_s=8.0, rate_hz=5.0, spacing_mm=8.0))
        with pytest.raises(StepBlockedError, match="uncover it"):
            bench.run(StartHandheldMapping())
    finally:
        bench.close()


@pytest.mark.slow
def test_with_a_registered_robot_the_maps_are_in_its_base_and_the_delay_is_known():
    bench = new_workbench(Session())
    try:
        bench.dispatch(SetSeed(1))
        bench.dispatch(SetTracker(profile="vega"))
        tool = StartToolCapture(n_pivot=12, n_translate=5)
        for activity in (tool, StartHandheldCalibration(), QUICK, StartHandheldMapping()):
            bench.run(activity)
        made = bench.session.results.sono_maps.value
        assert made.frame == "base"
        assert made.delay_s == required(DELAY, bench.session)
        assert made.delay_s >= 0.014
        figures = bench.figures()
        assert figures["sono_outer_rms_mm"] < 0.6
        assert figures["sono_coverage_fraction"] > 0.95
        assert all(figures[key] is not None for key in SONO_KEYS)
    finally:
        bench.close()


@pytest.mark.ci
def test_a_probe_that_the_tracker_lost_counts_at_no_ascan(by_hand):
    bench = new_workbench(by_hand.session)
    try:
        bench.dispatch(SetToolVisible("sonopointer", False))
        bench.run(StartHandheldScan(duration_s=5.0, rate_hz=5.0, spacing_mm=8.0))
        assert len(bench.session.captures.sono_scan.scans) == 25
        with pytest.raises(DegenerateGeometryError, match="none of the 25 A-scans"):
            bench.run(StartHandheldMapping())
    finally:
        bench.close()


@pytest.mark.parametrize(
    "make",
    [
        lambda: StartHandheldCalibration(cone_deg=0.5),
        lambda: StartHandheldCalibration(half_turn_deg=90.0),
        lambda: StartHandheldCalibration(spin_s=np.inf),
        lambda: StartHandheldScan(duration_s=1.0),
        lambda: StartHandheldScan(rate_hz=0.0),
        lambda: StartHandheldScan(spacing_mm=0.1),
        lambda: StartHandheldMapping(sound_speed_mm_per_us=9.0),
        lambda: StartHandheldMapping(cell_mm=0.1),
    ],
)
def test_values_out_of_range_are_refused(make):
    with pytest.raises(InvalidInputError):
        make()
