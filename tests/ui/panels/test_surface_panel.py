"""Step 4: a loaded skull can be registered there, a simulated one cannot."""

from dataclasses import replace

import numpy as np

from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.surface.messages import StartSkullRegistration
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.session.document import Derived, Session
from rona_core.session.specimen import LoadedSkull
from rona_ui.panels.surface import SurfacePanel
from rona_ui.presentation.view_state import ViewState
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

WORDS = "Register loaded skull"


def loaded() -> LoadedSkull:
    axis = np.zeros(3)
    return LoadedSkull(
        name="bone.nrrd",
        kind="mask",
        sha256=("0",),
        threshold=None,
        smoothing_mm=1.0,
        distance_um=np.zeros((8, 8, 8), dtype=np.int16),
        spacing_mm=1.0,
        origin_skull=axis,
        axes_skull=np.eye(3),
        mesh_vertices_skull=np.zeros((3, 3), dtype=np.float32),
        mesh_faces=np.zeros((1, 3), dtype=np.int32),
        center_skull=axis,
        normal_skull=np.array((0.0, 0.0, 1.0)),
        radius_mm=10.0,
        mean_thickness_mm=5.0,
    )


def sampled(session: Session) -> Session:
    cloud = SurfaceCloud(np.zeros((5, 3)), np.arange(5.0), np.zeros(5, dtype=np.int64), 0, 5, 0.1)
    made = Derived(cloud, "BuildSurface", {}, {})
    return replace(session, results=replace(session.results, surface=made))


def test_only_a_loaded_skull_with_points_can_be_registered() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SurfacePanel(gui, recorder.context)
    button = gui.find("button", WORDS)
    view = ViewState(step="surface")
    with_skull = replace(Session(), setup=replace(Session().setup, specimen=loaded()))
    for session, offered in (
        (Session(), False),
        (sampled(Session()), False),
        (with_skull, False),
        (sampled(with_skull), True),
    ):
        panel.render(None, snapshot(session, view=view))
        assert button.visible is offered
    button.happen(CLIENT)
    assert recorder.sent == [StartSkullRegistration()]
    running = JobStatus("1", "StartSkullRegistration", "running", 0.1)
    panel.render(None, snapshot(sampled(with_skull), view=view, job=running))
    assert button.disabled
    panel.render(None, snapshot(sampled(with_skull), view=replace(view, drawing="surface")))
    assert not button.visible
