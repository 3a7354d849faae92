"""Reference points, delay line and sweep in a session: stored, used, stale, undone, replayed."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.session_step import Undo, recompute
from rona_core.app.steps.acoustics.derivation import ECHO_DEPTHS, HELD_PROBE, KNOWN_SPEED
from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateDelayLine,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartCaliperMeasurements,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.acoustics.view import (
    edited_probe,
    gain_words,
    probe_values,
    reference_gain,
    reference_rows,
    thickness_shares,
)
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.setup.messages import SetProbe, SetSeed, SetWorld
from rona_core.compose import new_workbench
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.session.codec import decode, digest, encode
from rona_core.session.document import Session
from rona_core.ultrasound.probe.probe_model import probe_model
from tests.helpers.derived import derived
from tests.scenes.demo_parts import without_reference_points


@pytest.fixture(scope="module")
def mapped():
    return without_reference_points()


@pytest.fixture(scope="module")
def calibrated(mapped):
    bench = new_workbench(mapped)
    bench.run(StartCaliperMeasurements(n=3))
    yield bench.session
    bench.close()


def test_a_block_gives_the_line_that_detection_then_takes():
    bench = new_workbench(Session())
    bench.dispatch(SetWorld("nominal"))  # where the line is as warm as told
    bench.dispatch(SetProbe(line_temperature_c=35.0))
    nominal = probe_model(bench.session.setup.devices.probe).line_delay_us
    bench.run(StartDelayLineCapture(n=8))
    line = bench.session.results.line.value
    slower = 1.60 / (1.60 - 0.0025 * 13.0)  # rubber slows down as it warms
    assert line.delay_us == pytest.approx(nominal * slower, abs=0.02)
    assert required(HELD_PROBE, bench.session).line_delay_us == pytest.approx(
        line.delay_us, abs=1e-9
    )
    assert judge_part("line", bench.session).state == "weak"  # one temperature only
    bench.run(StartDelayLineCapture(n=8, temperatures_c=(20.0, 30.0, 40.0)))
    line = bench.session.results.line.value
    assert line.slope_measured
    assert line.at(35.0)[0] == pytest.approx(nominal * slower, abs=0.02)
    bench.dispatch(SetProbe(name="1MHz"))
    assert judge_part("line", bench.session).state == "stale"
    assert required(HELD_PROBE, bench.session) == probe_model("1MHz")
    bench.dispatch(Undo())
    assert judge_part("line", bench.session).state == "usable"
    bench.dispatch(CalibrateDelayLine(use=False))
    assert required(HELD_PROBE, bench.session).line_delay_us == nominal
    bench.close()


def test_a_sweep_is_stored_by_the_session_and_outlives_a_change_of_set_up():
    bench = new_workbench(Session())
    bench.run(StartProbeSweep(probes=("2.25MHz",), snr_db=(50.0,), thickness_mm=(5.0,), n=9))
    found = bench.session.results.what_if.value
    assert found.excitations == ("pulse", "chirp")
    arrays = {}
    plain = encode(bench.session.results, "r", arrays)
    again = decode(plain, type(bench.session.results), arrays, "r")
    assert digest(again.what_if.value) == digest(found)
    bench.dispatch(SetSeed(5))
    assert bench.session.results.what_if.value is found
    bench.close()


def test_nothing_can_be_calibrated_before_there_is_a_scan():
    bench = new_workbench(Session())
    for message in (CalibrateSoundSpeed(), CalibrateDelayLine(), AddReferencePoint(5.0, scan=0)):
        with pytest.raises(StepBlockedError, match="first"):
            bench.dispatch(message)
    with pytest.raises(StepBlockedError, match="first"):
        bench.run(StartCaliperMeasurements())
    with pytest.raises(InvalidInputError, match="no reference point"):
        bench.dispatch(RemoveReferencePoint())
    bench.close()


@pytest.mark.ci
def test_three_places_by_caliper_change_the_map_and_not_the_detection(mapped, calibrated):
    points, speed = calibrated.captures.references, calibrated.results.speed.value
    assert len(points.thickness_mm) == len(speed) == 3
    assert calibrated.archive[-1] is points
    assert speed.sigma_mm_per_us < 0.08  # the published spread of patients
    assert stale_reason("detection", calibrated) is None
    assert "speed" in stale_reason("maps", calibrated)
    bench = new_workbench(calibrated)
    bench.run(StartMapping())
    after = bench.session
    assert digest(after.results.detection.value) == digest(mapped.results.detection.value)
    assert stale_reason("speed", after) is None
    assert stale_reason("maps", after) is None
    both = mapped.results.maps.value.inner.ok & after.results.maps.value.inner.ok
    ratio = (
        after.results.maps.value.thickness_mm()[both]
        / mapped.results.maps.value.thickness_mm()[both]
    )
    assert not np.allclose(ratio, 1.0, atol=1e-3)
    before, now = thickness_shares(mapped), thickness_shares(after)
    assert (before.points, now.points) == (0, 3)
    assert now.patient_mm < before.patient_mm
    bench.run(StartMapping(sound_speed_mm_per_us=2.66))
    assert thickness_shares(bench.session).points == 0  # a speed in words wins
    bench.close()


@pytest.mark.slow
def test_the_gain_that_is_promised_is_the_one_that_comes(mapped):
    gain = reference_gain(mapped)
    assert gain.now_mm == pytest.approx(thickness_shares(mapped).total_mm, rel=0.02)
    bench = new_workbench(mapped)
    bench.run(StartCaliperMeasurements())
    places = bench.session.captures.references.places_base
    depths = required(ECHO_DEPTHS, mapped)
    np.testing.assert_array_equal(places, depths.places_base[np.isin(depths.scans, gain.scans)])
    bench.run(StartMapping())
    came = thickness_shares(bench.session)
    assert came.total_mm == pytest.approx(gain.then_mm, rel=0.15)
    assert came.total_mm < 0.7 * gain.now_mm
    more = reference_gain(bench.session, 2)
    assert more.now_mm == pytest.approx(came.total_mm, rel=0.02)
    assert more.then_mm < more.now_mm
    assert not np.isin(more.scans, gain.scans).any()
    assert "± 0." in gain_words(gain)
    assert reference_gain(Session()) is None
    bench.run(StartCaliperMeasurements(n=2, append=True))
    assert len(bench.session.results.speed.value) == 5
    bench.close()


def test_points_by_hand_are_added_removed_and_taken_back(mapped):
    bench = new_workbench(mapped)
    detection = mapped.results.detection.value
    sure = np.flatnonzero(detection.inner_ok)
    unsure = int(np.flatnonzero(~detection.inner_ok)[0])
    with pytest.raises(InvalidInputError, match="no inner boundary"):
        bench.dispatch(AddReferencePoint(5.0, scan=unsure))
    with pytest.raises(InvalidInputError, match="numbered from 0"):
        bench.dispatch(AddReferencePoint(5.0, scan=len(detection)))
    for scan in sure[[0, len(sure) // 2, -1]]:
        known = float(detection.thickness_mm[scan])
        bench.dispatch(AddReferencePoint(known, scan=int(scan)))
    assert [row.off_mm for row in reference_rows(bench.session)] == [None] * 3
    bench.dispatch(RemoveReferencePoint(1))
    assert len(reference_rows(bench.session)) == 2
    bench.dispatch(Undo())
    assert len(reference_rows(bench.session)) == 3
    bench.dispatch(CalibrateSoundSpeed())
    assert judge_part("speed", bench.session).state in ("usable", "weak")
    assert KNOWN_SPEED.read(bench.session) is not None
    bench.dispatch(RemoveReferencePoint())
    assert bench.session.captures.references is None
    assert KNOWN_SPEED.read(bench.session) is None
    assert judge_part("speed", bench.session).state == "stale"
    with pytest.raises(InvalidInputError, match="either"):
        AddReferencePoint(5.0)
    bench.close()


def test_another_patient_makes_the_points_stale(calibrated):
    other = replace(calibrated, setup=replace(calibrated.setup, seed=calibrated.setup.seed + 1))
    assert stale_reason("capture references", other) is not None
    assert KNOWN_SPEED.read(other) is None


def test_the_speed_is_the_same_when_it_alone_is_computed_again(calibrated):
    held = calibrated.results.speed
    again = derived("speed", calibrated, message_from(held.message, held.arguments))
    assert digest(again) == digest(held.value)


@pytest.mark.ci
def test_the_speed_is_the_same_when_it_is_computed_again(calibrated):
    kept = replace(calibrated.results, roll=calibrated.results.roll)
    fresh = recompute(replace(calibrated, results=kept))
    assert digest(fresh.results.speed.value) == digest(calibrated.results.speed.value)


def test_edited_values_that_are_the_probes_own_are_no_edit():
    settings = ProbeSettings()
    same = edited_probe(settings, probe_values(settings))
    assert ProbeSettings(**same) == settings
    changed = edited_probe(settings, {**probe_values(settings), "bandwidth": 0.7})
    assert ProbeSettings(**changed) == replace(settings, bandwidth=0.7)
