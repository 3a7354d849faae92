"""The thickness that one A-scan is told to have, and judged by, is at the speed of the maps."""

from dataclasses import replace

import numpy as np

from rona_core.app.steps.boundaries.ascan_view import ascan_plot, scan_poses
from rona_core.evaluation.scan_metrics import detected_passes
from rona_core.mapping.build_maps import boundary_points
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at


def at_map_speed_mm(session: Session) -> np.ndarray:
    found = session.results.detection.value
    places = boundary_points(found, scan_poses(session))[0]
    speed = speed_at(session.results.speed.value, places)[0]
    return found.thickness_mm * speed / found.sound_speed_mm_per_us


def test_failures_are_counted_at_the_speed_of_the_maps(demo):
    (first, _), (second, _) = detected_passes(demo)
    off_mm = demo.results.maps.value.offsets_mm[0]  # of the first pass as a whole
    np.testing.assert_allclose(first.thickness_mm, at_map_speed_mm(demo) - off_mm)
    published = demo.results.second_detection.value.thickness_mm
    assert np.abs(second.thickness_mm / published - 1.0).max() > 1e-3


def test_without_a_caliper_they_are_counted_at_the_published_speed(demo):
    results = replace(demo.results, speed=None)
    (first, _), _ = detected_passes(replace(demo, results=results))
    off_mm = demo.results.maps.value.offsets_mm[0]
    published_mm = demo.results.detection.value.thickness_mm
    np.testing.assert_allclose(first.thickness_mm, published_mm - off_mm)


def test_the_words_below_an_ascan_agree_with_the_map(demo):
    found = demo.results.detection.value
    i = int(np.flatnonzero(found.flag == 0)[20])
    thickness_mm = at_map_speed_mm(demo)[i]
    assert abs(thickness_mm - found.thickness_mm[i]) > 0.02, "else the test tells nothing"
    told = ascan_plot(demo, i).remark
    assert f"bone {thickness_mm:.2f} ± " in told
    before = ascan_plot(replace(demo, results=replace(demo.results, speed=None)), i).remark
    assert f"bone {found.thickness_mm[i]:.2f} ± " in before
    assert sigma_told(told) < sigma_told(before), "a caliper makes it surer"


def sigma_told(remark: str) -> float:
    return float(remark.split(" ± ")[1].split(" mm")[0])
