"""The predicted error of the pointer's map: from the session alone, of the size of the truth."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.overview.predicted_accuracy import predict_surface, predicted_figures
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetPointer, SetSeed, SetTracker
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import build_virtual_rig, new_workbench
from rona_core.devices.trackers import ACCURACY_MM
from rona_core.evaluation.navigation_metrics import tip_errors
from rona_core.evaluation.truth import truth_of
from rona_core.session.document import Session
from rona_core.virtual.tracker.marker_error import SPECS
from tests.helpers.recordings import track_rows

KEYS = (
    "tool_tip_sigma_mm",
    "pointer_tip_sigma_mm",
    "tracker_registration_sigma_mm",
    "surface_sigma_predicted_mm",
    "skull_registration_sigma_mm",
)


def sampled(profile, pointer="pointer6d", seed=0):
    bench = new_workbench(Session())
    bench.dispatch(SetSeed(seed))
    bench.dispatch(SetTracker(profile=profile))
    bench.dispatch(SetPointer(pointer))
    for step in (
        StartToolCapture(),
        StartPointerCapture(duration_s=8.0),
        StartSurfaceCapture(duration_s=15.0),
    ):
        bench.run(step)
    yield bench.session, bench.figures()
    bench.close()


@pytest.fixture(scope="module")
def polaris():
    yield from sampled("polaris")


@pytest.fixture(scope="module")
def white():
    yield from sampled("white035")


def test_the_makers_figures_are_those_of_the_virtual_tracker():
    assert {name: spec.total_mm for name, spec in SPECS.items()} == ACCURACY_MM


def local_error_mm(session):
    """3D RMS of the cloud's true error less its mean."""
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    errors = tip_errors(session.results.surface.value, session.captures.surface, truth)
    return np.sqrt(((errors - errors.mean(axis=0)) ** 2).sum(axis=1).mean())


@pytest.mark.sweep(1)
@pytest.mark.parametrize("world", ["polaris", "white"])
def test_the_prediction_is_of_the_size_of_the_error(world, request):
    session, figures = request.getfixturevalue(world)
    predicted = figures["surface_sigma_predicted_mm"]
    assert predicted == predict_surface(session).normal_mm
    assert 0.4 < predicted / figures["surface_rms_mm"] < 2.5
    assert figures["tool_tip_sigma_mm"] == session.results.tool.value.tip_sigma_mm
    assert figures["pointer_tip_sigma_mm"] == session.results.pointer.value.tip_sigma_mm


@pytest.mark.parametrize("frames", [slice(0, 49), slice(1, None)])
def test_a_capture_that_a_calibration_was_not_made_of_tells_nothing_of_it(polaris, frames):
    session, _ = polaris
    before, pointer = predict_surface(session), session.results.pointer.value
    capture = session.captures.pointer
    rows = np.arange(len(capture.marker.times_s))[frames]  # recorded again, not yet calibrated
    other = replace(capture, marker=track_rows(capture.marker, rows))
    found = predict_surface(session.with_capture("pointer", other))
    # nobody knows how much of it the tracker does the same at the surface: all of it counts
    assert found.pointer_mm == pytest.approx(pointer.tip_sigma_mm)
    assert found.pointer_mm > before.pointer_mm
    assert found.registration_mm == pytest.approx(before.registration_mm)


def test_a_registration_of_an_earlier_capture_counts_with_all_that_it_states(polaris):
    session, _ = polaris
    before, held = predict_surface(session), session.captures.tool
    fewer = {name: getattr(held, name)[::2] for name in ("dwell_start_s", "dwell_end_s", "phases")}
    found = predict_surface(session.with_capture("tool", replace(held, **fewer)))
    assert found.registration_mm > before.registration_mm
    assert found.robot_mm == 0.0  # it is in the registration
    assert found.pointer_mm == pytest.approx(before.pointer_mm)


def test_the_parts_add_up_and_along_normals_there_is_less(polaris):
    found = predict_surface(polaris[0])
    chance = (found.registration_mm, found.pointer_mm, found.frame_mm)
    parts = (*chance, found.tracker_mm, found.robot_mm)
    assert found.rms_mm == pytest.approx(np.linalg.norm(parts))
    # the tracker errs alike at registration and surface, and that part cancels
    assert 0.05 < found.tracker_mm < ACCURACY_MM["polaris"]
    assert found.robot_mm == pytest.approx(0.35, rel=0.2)
    assert found.normal_mm < found.rms_mm
    assert found.frames == 7  # 0.1 s at 60 frames a second, the one in the middle too


def test_what_places_share_and_what_each_has_make_the_whole(polaris):
    found = predict_surface(polaris[0])
    assert np.linalg.eigvalsh(found.common).min() > 0.0
    assert np.linalg.eigvalsh(found.local).min() > 0.0
    # the variance over places is that of the mean and that about it
    shared, own = np.trace(found.common), np.trace(found.local.mean(axis=0))
    assert np.trace(found.whole.mean(axis=0)) == pytest.approx(shared + own)
    true = local_error_mm(polaris[0])
    assert np.sqrt(own) == pytest.approx(true, rel=0.2)


def test_calibrations_hold_what_repeats_apart_from_chance(polaris):
    results = polaris[0].results
    tool, pointer = results.tool.value, results.pointer.value
    assert tool.tip_sigma_mm**2 == pytest.approx(np.trace(tool.covariance[9:, 9:]))
    assert pointer.tip_sigma_mm**2 == pytest.approx(np.trace(pointer.tip_covariance_pointermarker))
    for total, random in (
        (tool.covariance, tool.random_covariance),
        (pointer.tip_covariance_pointermarker, pointer.random_covariance),
    ):
        more = total - random
        assert np.linalg.eigvalsh(more).min() > -1e-9 * np.abs(total).max()
        assert np.trace(more[-3:, -3:]) > 3.0 * np.trace(random[-3:, -3:])


@pytest.mark.slow
def test_a_tracker_of_white_noise_leaves_noise_and_what_averaging_rounds_off(white):
    session = white[0]
    found = predict_surface(session)
    assert found.tracker_mm == 0.0
    cloud = session.results.surface
    single = replace(cloud, value=replace(cloud.value, average_s=0.0))
    once = predict_surface(replace(session, results=replace(session.results, surface=single)))
    assert once.frames == 1
    # seven frames round off the way of the hand, which a single one does not
    assert found.frame_mm**2 > once.frame_mm**2 / 7.0
    assert np.sqrt(np.trace(found.local.mean(axis=0))) == pytest.approx(
        local_error_mm(session), rel=0.2
    )
    assert once.registration_mm == found.registration_mm


def test_what_is_missing_has_no_prediction(polaris):
    session = polaris[0]
    others = (
        "thickness_sigma_predicted_mm",
        "coverage_predicted_fraction",
        "scan_duration_predicted_s",
        "outer_sigma_predicted_mm",
        "inner_sigma_predicted_mm",
        "thickness_map_sigma_predicted_mm",
    )
    assert predicted_figures(Session()) == dict.fromkeys((*KEYS, *others))
    for name in ("tool", "pointer", "surface"):
        less = replace(session, results=replace(session.results, **{name: None}))
        assert predict_surface(less) is None
        assert predicted_figures(less)["surface_sigma_predicted_mm"] is None
    other = replace(session.captures.surface[0], pointer="pointer5d")
    assert (
        predict_surface(replace(session, captures=replace(session.captures, surface=(other,))))
        is None
    )


@pytest.mark.slow
def test_a_pointer_with_collinear_markers_is_predicted_too():
    for session, figures in sampled("polaris", "pointer5d"):
        found = predict_surface(session)
        own = np.sqrt(np.trace(found.local.mean(axis=0)))
        assert own == pytest.approx(local_error_mm(session), rel=0.2)
        assert 0.4 < found.normal_mm / figures["surface_rms_mm"] < 2.5
