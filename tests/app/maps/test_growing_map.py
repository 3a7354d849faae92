"""The outer map that grows during a scan: made of the demo's scan as it came, bit by bit."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.derivation import ROBOT_PROBE
from rona_core.app.steps.maps.growing_map import MapGrower
from rona_core.devices.live import RecordedSoFar
from rona_core.devices.samples import AScan, JointSample
from rona_core.errors import DegenerateGeometryError
from rona_core.session.document import Session
from rona_core.ultrasound.detection.single.outer_boundary import detect_outer
from rona_core.ultrasound.probe.probe_model import ProbeSurvey


def so_far(capture, n):
    """The first n A-scans, and the joint angles that had come with the last of them."""
    track, angles = capture.scans, capture.joints
    scans = tuple(
        AScan(float(t), rf, track.sampling_mhz, track.start_us, bool(clipped))
        for t, rf, clipped in zip(track.times_s[:n], track.rf, track.clipped, strict=False)
    )
    come = np.searchsorted(angles.times_s, track.times_s[:n][-1] if n else 0.0)
    joints = zip(angles.times_s[:come], angles.qs_rad, strict=False)
    return RecordedSoFar(scans, tuple(JointSample(float(t), q) for t, q in joints))


def test_it_grows_into_what_step_9_maps(demo):
    capture, grower = demo.captures.scan, MapGrower(demo, "first", 7)
    grown = [grower.grown(so_far(capture, n)) for n in (0, 10, 100, 300, len(capture.scans))]
    assert [g.ordinal for g in grown] == [7] * 5
    assert grown[0].n_scans == len(grown[0].points_base) == 0
    assert len(grown[1].points_base) == grown[1].n_seen  # a line: the A-scans' own points
    assert all(len(a.points_base) < len(b.points_base) for a, b in pairwise(grown))
    last, outer = grown[-1], demo.results.maps.value.outer
    assert last.n_scans >= len(capture.scans) - 1  # of the last one joint angles may be missing
    places = outer.T_base_map.inv() @ last.points_base
    chart = RectBivariateSpline(outer.u_mm, outer.v_mm, outer.height_mm)
    off_mm = chart.ev(places[:, 0], places[:, 1]) - places[:, 2]
    assert abs(off_mm.mean()) < 0.05
    assert off_mm.std() < 0.05
    inside = (last.heights_mm >= last.low_mm) & (last.heights_mm <= last.high_mm)
    assert inside.mean() > 0.98


def test_how_often_one_looked_changes_nothing_but_the_noise_that_is_read_off(demo):
    capture = demo.captures.scan
    often, once = MapGrower(demo, "first", 1), MapGrower(demo, "first", 1)
    for n in range(32, 224, 32):
        often.grown(so_far(capture, n))
    a, b = often.grown(so_far(capture, 224)), once.grown(so_far(capture, 224))
    assert (a.n_scans, a.n_seen) == (b.n_scans, b.n_seen)
    np.testing.assert_allclose(a.heights_mm, b.heights_mm, atol=2e-3)


def test_the_outer_boundary_alone_is_that_of_the_whole_detection(demo):
    found, probe = demo.results.detection.value, required(ROBOT_PROBE, demo)
    track = demo.captures.scan.scans
    alone = detect_outer(ProbeSurvey(track, probe, demo.setup.devices.probe.excitation))
    np.testing.assert_array_equal(alone.ok, found.outer_ok)
    np.testing.assert_allclose(
        alone.standoff_mm[alone.ok], found.standoff_mm[found.outer_ok], atol=1e-9
    )


def test_the_second_pass_grows_a_map_of_its_own_rows(demo):
    grown = MapGrower(demo, "second", 9).grown(so_far(demo.captures.second[0], 200))
    outer = demo.results.maps.value.outer
    places = outer.T_base_map.inv() @ grown.points_base
    chart = RectBivariateSpline(outer.u_mm, outer.v_mm, outer.height_mm)
    off_mm = chart.ev(places[:, 0], places[:, 1]) - places[:, 2]
    assert np.median(np.abs(off_mm)) < 0.1
    assert 0.2 * grown.n_scans < grown.n_seen < grown.n_scans


def test_without_a_plan_there_is_nothing_to_lay_a_map_along():
    with pytest.raises(DegenerateGeometryError, match="no planned path"):
        MapGrower(Session(), "first", 1)
