"""The quick look in a session: recorded before a scan, kept, fresh for both probes, told to all."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import blocked
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import derive_again, handle
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.app.steps.scan.step import SHOTS, line_rows, probe_advice
from rona_core.app.steps.setup.messages import SetBoneModel, SetProbe, SetRegion
from rona_core.compose import new_workbench
from rona_core.devices.protocols import never, silent
from rona_core.errors import CancelledError, DeviceError
from rona_core.geometry.path5d import Path5D
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.ultrasound.detection.probe_choice import ExpectedCoverage, QuickLook
from rona_core.virtual.acoustics import plates
from tests.helpers.session_file import reopened
from tests.scenes import demo_parts

LINES = 4


@pytest.fixture(scope="module")
def looked():
    """The demo session before its scan, with a quick look."""
    bench = new_workbench(demo_parts.demo().with_capture("scan", None))
    shares = []
    bench.run(StartQuickLook(lines=LINES), shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    yield bench.session
    bench.close()


def test_each_probe_looks_at_the_same_lines_upright_and_tilted(looked):
    held, path = looked.captures.get("looks"), looked.results.smoothing.value.path
    assert [probe.name for probe in held.probes] == ["2.25MHz", "1MHz"]
    assert [len(track) for track in held.tracks] == [LINES * SHOTS] * 2 * 5
    assert held.places_base.shape == (LINES * SHOTS, 3)
    upright, *tilted = held.axes_base
    np.testing.assert_array_equal(upright, path.axes_base[line_rows(path, LINES)])
    for axes in tilted:
        cosines = np.einsum("ij,ij->i", axes, upright)
        np.testing.assert_allclose(np.rad2deg(np.arccos(cosines)), 5.0, atol=1e-6)


def test_lines_are_spread_over_the_path_and_follow_it():
    way = np.arange(0.0, 100.5, 0.5)
    path = Path5D(
        np.column_stack((way, 0.0 * way, 0.0 * way)), np.tile((0.0, 0.0, -1.0), (len(way), 1))
    )
    found = path.points_base[line_rows(path, 4), 0].reshape(4, SHOTS)
    np.testing.assert_allclose(np.diff(found), 1.0)
    np.testing.assert_allclose(found.mean(axis=1), (20.0, 40.0, 60.0, 80.0))


def test_it_stays_where_the_other_probe_is_chosen_and_goes_with_bone_and_receiver(looked):
    assert probe_advice(Session()) is None
    held = asdict(looked.setup.devices.probe)
    for name in ("2.25MHz", "1MHz"):
        chosen = handle(SetProbe(**{**held, "name": name, "pitch_mm": 2.0}), looked)
        assert stale_reason("quick_look", chosen) is None
        assert probe_advice(chosen).used == name
    for message in (
        SetProbe(**{**held, "shots": 7}),
        SetProbe(**{**held, "centre_mhz": 2.0}),
        SetBoneModel(kind="hard"),
        SetRegion(radius_mm=20.0),
    ):
        after = handle(message, looked)
        assert stale_reason("quick_look", after) is not None
        assert probe_advice(after) is None


def test_it_is_kept_in_the_file_and_computed_again_from_what_was_recorded(looked):
    again = reopened(looked)
    assert digest(again.captures.get("looks")) == digest(looked.captures.get("looks"))
    held = looked.results.get("quick_look")
    assert again.results.get("quick_look").value == held.value
    assert derive_again("quick_look", again, held, silent, never) == held.value


def told(session, fine, coarse):
    """Return a session whose quick look has come to these coverages."""
    found = tuple(
        ExpectedCoverage(name, share, share, 0.0)
        for name, share in (("2.25MHz", fine), ("1MHz", coarse))
    )
    held = replace(session.results.get("quick_look"), value=QuickLook(LINES, found))
    return session.with_result("quick_look", held)


def test_the_advice_says_where_to_choose_the_probe_and_to_scan_again_after_a_scan(looked, demo):
    before = probe_advice(told(looked, 0.4, 1.0))
    assert before.another
    assert before.sentence.endswith("Choose it in step 1.")
    after = told(looked, 0.4, 1.0).with_capture("scan", demo.captures.scan)
    assert probe_advice(after).sentence.endswith("Choose it in step 1 and scan again.")
    assert not probe_advice(told(looked, 0.9, 1.0)).another


def test_it_needs_a_path_and_nothing_is_kept_of_one_that_was_cancelled(looked):
    assert "step 6" in blocked(StartQuickLook, Session()).reason
    bench = new_workbench(looked)
    shares = []
    with pytest.raises(CancelledError, match="nothing of it is kept"):
        bench.run(StartQuickLook(lines=LINES), shares.append, lambda: bool(shares))
    assert len(shares) == 1
    assert bench.session.captures.get("looks") is looked.captures.get("looks")
    bench.close()


def test_the_virtual_probe_stands_as_the_collar_holds_it_and_only_on_bone(looked):
    bench = new_workbench(looked)
    rig, held = bench.rig(), looked.captures.get("looks")
    places, axes, probe = held.places_base, held.axes_base[0], held.probes[0]
    track = rig.bench.record_on_bone(probe, places, axes, 1.0)
    assert isinstance(rig.bench, plates.VirtualBench)
    assert len(track) == len(places)
    with pytest.raises(DeviceError, match="no bone at place 2"):
        rig.bench.record_on_bone(probe, places[:2] + [[0.0] * 3, [500.0] * 3], axes[:2], 1.0)
    bench.close()
