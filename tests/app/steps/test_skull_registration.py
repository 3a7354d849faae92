"""A loaded skull is found in base from the pointer's cloud alone; what is weak is said."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.predicted_accuracy import predict_skull_mm
from rona_core.app.runtime.session_step import Undo, replay
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetSeed, StoreSkull
from rona_core.app.steps.surface.derivation import outer_surface
from rona_core.app.steps.surface.messages import (
    BuildSurface,
    StartSkullRegistration,
    StartSurfaceCapture,
)
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench, read_skull
from rona_core.errors import CancelledError, InvalidInputError, StepBlockedError
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_core.session.specimen import SimulatedSkull
from rona_core.virtual.specimen.build_specimen import build_specimen
from rona_ui.panels.surface import registered as words_of
from rona_ui.scene.pointer import contours
from tests.helpers.derived import derived
from tests.helpers.session_file import reopened
from tests.helpers.sphere_world import boundary_meshes

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A session with a skull from a mesh, and the pointer's cloud on it."""
    truth = build_specimen(SimulatedSkull(), 4)
    path = tmp_path_factory.mktemp("skull") / "head.ply"
    trimesh.util.concatenate(boundary_meshes(truth, 3.0)).export(path)
    center = tuple(map(float, truth.region.center_skull))
    skull = read_skull(
        str(path), None, None, center, 25.0, progress=lambda share: None, cancel=lambda: False
    )
    bench = new_workbench(Session())
    bench.store.dispatch(StoreSkull(skull))
    for step in (
        StartToolCapture(),
        StartPointerCapture(duration_s=8.0),
        StartSurfaceCapture(duration_s=30.0),
    ):
        bench.run(step)
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def registered(bench):
    told = []
    bench.run(StartSkullRegistration(), told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    return bench.session


def test_the_outer_surface_is_that_of_the_bone(bench):
    points, normals = outer_surface(bench.session.setup.specimen)
    specimen = bench.rig().scene.specimen
    near = np.linalg.norm(points - specimen.region.center_skull, axis=1) < 30.0
    feet = specimen.closest(points[near])
    np.testing.assert_allclose(np.linalg.norm(points[near] - feet, axis=1), 0.0, atol=0.02)
    cosines = (normals[near] * specimen.normal(feet)).sum(axis=1)
    assert cosines.min() > np.cos(np.deg2rad(3.0))


def test_the_skull_is_found_as_well_as_the_pointer_measures(bench, registered):
    found = registered.results.registration.value
    figures = bench.figures()
    tip_error_mm = figures["surface_tip_3d_rms_mm"]
    assert figures["skull_registration_tre_mm"] < 1.5 * tip_error_mm + 0.2
    assert 0.3 < figures["skull_registration_tre_mm"] / figures["skull_registration_sigma_mm"] < 3.0
    assert found.used.mean() > 0.9
    assert found.rms_mm < 0.2
    assert found.verdict == "weak", "a patch of a round head"
    assert "nearly a piece of a sphere" in found.reasons[0]


def test_it_is_stored_saved_replayed_and_undone(bench, registered):
    derived = registered.results.registration
    assert derived.message == "StartSkullRegistration"
    again = reopened(registered)
    np.testing.assert_array_equal(
        again.results.registration.value.T_b_a.matrix(), derived.value.T_b_a.matrix()
    )
    assert {row.result: row.same for row in replay(registered)}["registration"]
    bench.dispatch(Undo())
    assert bench.session.results.registration is None


def test_another_cloud_makes_it_stale(bench, registered):
    assert stale_reason("registration", registered) is None
    bench.dispatch(BuildSurface(average_s=0.3))
    later = replace(
        bench.session,
        results=replace(bench.session.results, registration=registered.results.registration),
    )
    assert "surface was computed anew" in stale_reason("registration", later)
    bench.dispatch(Undo())


def test_a_guess_leads_to_the_same_place(registered):
    T_base_skull = registered.results.registration.value.T_b_a.inv()
    off = Pose.from_rotvec((0.02, -0.03, 0.02), (2.0, -1.0, 1.5)) @ T_base_skull
    guess = StartSkullRegistration(guess_wxyz=tuple(off.wxyz()), guess_mm=tuple(off.translation))
    found = derived("registration", registered, guess)
    middle = registered.results.surface.value.points_base.mean(axis=0)
    wanted = registered.results.registration.value.T_b_a @ middle
    np.testing.assert_allclose(found.T_b_a @ middle, wanted, atol=0.1)


def test_the_truth_is_not_asked(bench, registered):
    """Where the virtual skull lies follows from the seed; the result follows from the cloud."""
    other = replace(registered, setup=replace(registered.setup, seed=99))
    found = derived("registration", other, StartSkullRegistration())
    np.testing.assert_array_equal(
        found.T_b_a.matrix(), registered.results.registration.value.T_b_a.matrix()
    )


def test_the_browser_draws_it_where_it_is_and_says_how_well_it_is_known(bench, registered):
    skull, found = registered.setup.specimen, registered.results.registration.value
    assert contours(Session()).shape == (0, 2, 3)
    lines = contours(registered)
    feet = (found.T_b_a @ lines.reshape(-1, 3)) - np.asarray(skull.center_skull)
    near = feet[np.linalg.norm(feet, axis=1) < 20.0] + skull.center_skull
    specimen = bench.rig().scene.specimen
    assert len(near) > 50
    away_mm = np.linalg.norm(near - specimen.closest(near), axis=1)
    assert np.quantile(away_mm, 0.95) < 1.0, "nearly all on the outer table, the rest on the inner"
    html = words_of(registered)
    assert "▲ weak" in html
    assert FIGURES["skull_registration_sigma_mm"].words(predict_skull_mm(registered)) in html
    assert "Stale" not in html
    assert words_of(Session()) == ""


def test_what_cannot_be_registered_is_refused_by_name(bench, registered):
    plain = new_workbench(Session())
    with pytest.raises(StepBlockedError, match="needs a loaded CT"):
        plain.run(StartSkullRegistration())
    plain.dispatch(SetSeed(1))
    plain.close()
    bare = replace(registered, results=replace(registered.results, surface=None))
    with pytest.raises(StepBlockedError, match="sample the surface"):
        derived("registration", bare, StartSkullRegistration())
    with pytest.raises(InvalidInputError, match="both"):
        StartSkullRegistration(guess_mm=(0.0, 0.0, 0.0))
    with pytest.raises(CancelledError):
        derived("registration", registered, StartSkullRegistration(), cancel=lambda: True)
