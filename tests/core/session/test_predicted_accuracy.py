"""The predicted error of the pointer's map: from the session alone, of the size of the truth."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.overview.predicted_accuracy import predict_surface, predicted_figures
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetPointer, SetSeed, SetTracker
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.devices.tracker_volumes import ACCURACY_MM
from rona_core.session.document import Session
from rona_core.virtual.tracker.marker_error import SPECS

KEYS = (
    "tool_tip_sigma_mm",
    "pointer_tip_sigma_mm",
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


@pytest.mark.parametrize("world", ["polaris", "white"])
def test_the_prediction_is_of_the_size_of_the_error(world, request):
    session, figures = request.getfixturevalue(world)
    predicted = figures["surface_sigma_predicted_mm"]
    assert predicted == predict_surface(session).normal_mm
    assert 0.4 < predicted / figures["surface_rms_mm"] < 2.5
    assert figures["tool_tip_sigma_mm"] == session.results.tool.value.tip_sigma_mm
    assert figures["pointer_tip_sigma_mm"] == session.results.pointer.value.tip_sigma_mm


def test_the_parts_add_up_and_along_normals_there_is_less(polaris):
    found = predict_surface(polaris[0])
    parts = (found.registration_mm, found.pointer_mm, found.frame_mm, found.stated_mm)
    assert found.rms_mm == pytest.approx(np.linalg.norm(parts))
    assert 0.3 < found.stated_mm <= ACCURACY_MM["polaris"]
    assert found.normal_mm < found.rms_mm
    assert found.frames == 7  # 0.1 s at 60 frames a second, the one in the middle too


def test_a_tracker_of_white_noise_leaves_nothing_that_averaging_does_not_reduce(white):
    session = white[0]
    found = predict_surface(session)
    assert found.stated_mm < 0.15
    cloud = session.results.surface
    single = replace(cloud, value=replace(cloud.value, average_s=0.0))
    once = predict_surface(replace(session, results=replace(session.results, surface=single)))
    assert once.frames == 1
    assert once.frame_mm == pytest.approx(np.sqrt(7) * found.frame_mm)
    assert once.registration_mm == found.registration_mm


def test_what_is_missing_has_no_prediction(polaris):
    session = polaris[0]
    assert predicted_figures(Session()) == dict.fromkeys((*KEYS, "thickness_sigma_predicted_mm"))
    for name in ("tool", "pointer", "surface"):
        less = replace(session, results=replace(session.results, **{name: None}))
        assert predict_surface(less) is None
        assert predicted_figures(less)["surface_sigma_predicted_mm"] is None
    other = replace(session.captures.surface[0], pointer="pointer5d")
    assert (
        predict_surface(replace(session, captures=replace(session.captures, surface=(other,))))
        is None
    )


def test_a_pointer_with_collinear_markers_is_predicted_too():
    for session, figures in sampled("polaris", "pointer5d"):
        found = predict_surface(session)
        assert 0.01 < found.frame_mm < 0.3
        assert 0.4 < found.normal_mm / figures["surface_rms_mm"] < 2.5
