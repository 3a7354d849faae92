"""What detection gets from a scan: the same from each pass of the robot and from one by hand."""

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import rona_core.app
from rona_core.app.dependencies.references import REGISTERED
from rona_core.app.dependencies.staleness import input_digests, required, stale_reason
from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.acoustics.derivation import HELD_PROBE, KNOWN_SPEED, ROBOT_PROBE
from rona_core.app.steps.acoustics.messages import (
    CalibrateDelayLine,
    StartCaliperMeasurements,
    StartDelayLineCapture,
)
from rona_core.app.steps.handheld.derivation import HAND_POSES, POSED, hand_reference
from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.maps import derivation
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.derivation import PLACES, POSES, joined_poses
from rona_core.app.steps.setup.messages import SetProbe, SetSeed, SetWorld
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US
from rona_core.ultrasound.probe.probe_model import probe_model
from tests.helpers.derived import derived
from tests.scenes import demo_parts

WARM_C = 34.0


@pytest.fixture(scope="module")
def measured():
    """The demo session with its line calibrated on the block, and a short scan by hand."""
    session = demo_parts.demo()
    # whatever version planned the motion: its plan is that of the scans, and counts
    plan = replace(session.results.roll, inputs=input_digests("roll", session))
    session = replace(session, results=replace(session.results, roll=plan))
    bench = new_workbench(session)
    bench.run(StartDelayLineCapture(n=8, temperatures_c=(20.0, 30.0, 40.0)))
    bench.run(StartHandheldCalibration(pivot_s=8.0, spin_s=8.0))
    bench.run(StartHandheldScan(duration_s=12.0, rate_hz=15.0, spacing_mm=6.0))
    bench.run(StartMapping())
    yield bench.session
    bench.close()


class _AskedError(Exception):
    """Detection was asked; holds what it was given."""


@pytest.fixture
def asked(monkeypatch):
    def ask(name, session, message):
        def spy(*given, **named):
            raise _AskedError(given, named)

        monkeypatch.setattr(derivation, "detect", spy)
        with pytest.raises(_AskedError) as caught:
            derived(name, session, message)
        return caught.value.args

    return ask


def passes(session):
    """Return how each kind of scan is detected, what asks for it, its A-scans and its poses."""
    hand = session.captures.sono_scan
    posed = required(POSED, session)
    return {
        "first": (
            "detection",
            StartMapping,
            session.captures.scan.scans,
            required(POSES, session),
        ),
        "second": (
            "second_detection",
            StartMapping,
            session.captures.second[0].scans,
            joined_poses(required(PLACES, session), session.captures.second[:1]),
        ),
        "hand": (
            "sono_detection",
            StartHandheldMapping,
            replace(
                hand.scans,
                times_s=hand.scans.times_s[posed.known],
                rf=hand.scans.rf[posed.known],
                clipped=hand.scans.clipped[posed.known],
            ),
            HAND_POSES.read(session),
        ),
    }


@pytest.mark.slow
@pytest.mark.sweep(3)
@pytest.mark.parametrize("name", ["first", "second", "hand"])
@pytest.mark.parametrize("speed", [None, 2.75])
def test_every_kind_of_scan_gives_detection_all_that_is_known(measured, asked, name, speed):
    session = measured
    posed = required(POSED, session)
    frame, T_base_tracker, _ = hand_reference(
        session.captures.sono_scan, required(REGISTERED, session)
    )
    assert frame == "base"
    mounted = session.results.sono.value.T_sonomarker_probe
    result, message, scans, Ts_base_probe = passes(session)[name]
    (asked_for,), given = asked(result, session, message(sound_speed_mm_per_us=speed))
    probe = asked_for.probe
    np.testing.assert_array_equal(asked_for.track.rf, scans.rf)
    line = session.results.line.value
    known = required(HELD_PROBE, session) if name == "hand" else required(ROBOT_PROBE, session)
    assert probe == known != probe_model(session.setup.devices.probe)
    if name == "hand":  # another probe than the one that the gauge plate was screwed to
        assert probe.line_delay_us == pytest.approx(line.at(22.0)[0], abs=1e-9)
    assert asked_for.excitation == session.setup.devices.probe.excitation
    assert given["method"] == "subtract"
    learned = session.results.detection.value.bone_loss
    of_first = 1.0 if learned is None else learned
    assert given["bone_loss"] == (of_first if name == "second" else None)
    assert given["sound_speed_mm_per_us"] == (speed or NOMINAL_SPEED_MM_PER_US)
    places, axes = asked_for.positions_mm, asked_for.axes
    if name == "hand":  # there in the frame of the tracker, which stands still
        Ts_base_probe = T_base_tracker @ posed.Ts_tracker_marker @ mounted
        places, axes = T_base_tracker @ places, T_base_tracker.rotate(axes)
    np.testing.assert_allclose(places, Ts_base_probe.translations, atol=1e-9)
    np.testing.assert_allclose(axes, Ts_base_probe.rotations[:, :, 2], atol=1e-12)
    assert (asked_for.known_standoff_mm is None) == (name != "second")


def test_detection_is_called_at_one_place_for_all_scans():
    folder = Path(rona_core.app.__file__).parent
    callers = set()
    rooms = (folder, folder.parent / "mapping", folder.parent / "planning")
    for path in (path for room in rooms for path in room.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            called = node.func if isinstance(node, ast.Call) else None
            if isinstance(called, ast.Name) and called.id == "detect":
                callers.add(path.stem)
    # the touch-down of a scan is timed before anything is known of its poses;
    # the floor of a rehearsed bed is listened to without any survey in the session
    assert callers == {"derivation", "probe_poses", "milled_floor"}
    assert [part.name for part in fields(derivation.Survey)] == [
        "scans",
        "poses",
        "probe",
        "excitation",
        "known_standoff_mm",
        "bone_loss",
    ]


@pytest.mark.slow
def test_a_warm_line_that_was_calibrated_is_that_of_the_scan_by_hand():
    bench = new_workbench(Session())
    try:
        bench.dispatch(SetSeed(1))
        bench.dispatch(SetWorld("nominal"))  # where the line is as warm as told
        bench.dispatch(SetProbe(line_temperature_c=WARM_C))
        bench.run(StartDelayLineCapture(n=8))
        bench.run(StartHandheldCalibration(pivot_s=8.0, spin_s=8.0))
        bench.run(StartHandheldScan(duration_s=15.0, rate_hz=15.0, spacing_mm=5.0))
        bench.run(StartHandheldMapping())
        found = bench.session.results.sono_detection.value
        off_mm = bench.figures()["sono_outer_rms_mm"]
        bench.dispatch(CalibrateDelayLine(use=False))
        assert "line" in stale_reason("sono_detection", bench.session)
        assert stale_reason("sono_maps", bench.session) is not None
        bench.run(StartHandheldMapping())
        nominal = bench.session.results.sono_detection.value
        both = found.outer_ok & nominal.outer_ok
        lower = np.median((nominal.standoff_mm - found.standoff_mm)[both])
        warm = 1.60 / (1.60 - 0.0025 * (WARM_C - 22.0))  # rubber slows down as it warms
        late_us = 15.0 / 1.60 * 2.0 * (warm - 1.0)
        assert lower == pytest.approx(late_us * 1.5 / 2.0, abs=0.03)
        assert off_mm < bench.figures()["sono_outer_rms_mm"] - 0.03
    finally:
        bench.close()


@pytest.mark.slow
def test_the_calibrated_speed_holds_in_the_scan_by_hand_too(measured):
    before_caliper = measured.with_capture("references", None).with_result("speed", None)
    bench = new_workbench(before_caliper)
    try:
        bench.run(StartHandheldMapping())
        assert stale_reason("sono_maps", bench.session) is None
        before = bench.session.results.sono_maps.value.maps
        bench.run(StartCaliperMeasurements(n=3))
        assert "speed" in stale_reason("sono_maps", bench.session)
        assert stale_reason("sono_detection", bench.session) is None
        bench.run(StartHandheldMapping())
        after = bench.session.results.sono_maps.value.maps
        used = before.inner_used & after.inner_used
        thick = [
            np.linalg.norm(m.inner_points_base - m.outer_points_base, axis=1)[used]
            for m in (before, after)
        ]
        there = speed_at(KNOWN_SPEED.read(bench.session), before.outer_points_base[used])[0]
        np.testing.assert_allclose(thick[1] / thick[0], there / NOMINAL_SPEED_MM_PER_US, rtol=1e-4)
        assert np.abs(there / NOMINAL_SPEED_MM_PER_US - 1.0).max() > 0.002
        bench.run(StartHandheldMapping(sound_speed_mm_per_us=NOMINAL_SPEED_MM_PER_US))
        asked = bench.session.results.sono_maps.value.maps  # a speed that is asked for wins
        np.testing.assert_allclose(asked.inner_points_base, before.inner_points_base)
    finally:
        bench.close()


@pytest.mark.slow
def test_another_calibration_of_the_probe_makes_the_detection_by_hand_stale(measured):
    bench = new_workbench(measured)
    try:
        bench.run(StartHandheldMapping())
        bench.run(StartHandheldCalibration(pivot_s=9.0, spin_s=9.0))
        assert "calibration" in stale_reason("sono_detection", bench.session)
        bench.dispatch(Undo())
    finally:
        bench.close()


@pytest.mark.slow
def test_what_was_detected_without_the_places_counts_no_more(measured):
    bench = new_workbench(measured)
    try:
        bench.run(StartHandheldMapping())
        made = bench.session.results.sono_detection
        known = {key: made.inputs[key] for key in ("capture", "tool", "probe")}
        older = replace(made, inputs=known)  # as it was written before
        session = bench.session
        session = replace(session, results=replace(session.results, sono_detection=older))
        assert "without the calibration of the SonoPointer (step 9): do it again" in stale_reason(
            "sono_detection", session
        )
    finally:
        bench.close()
