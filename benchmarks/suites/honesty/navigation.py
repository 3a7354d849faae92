"""Navigation: tool, pointer, registration, cloud and normals against the truth."""

import numpy as np

from benchmarks.suites.honesty.design import bench_of
from benchmarks.suites.honesty.judged import Judged, principal_parts
from rona_core.app.dependencies.staleness import required
from rona_core.app.overview.predicted_accuracy import predict_surface
from rona_core.app.steps.path.inputs import VIEWPOINT
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.navigation_metrics import tip_errors
from rona_core.evaluation.truth import Truth, truth_of
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose_covariance import point_jacobians
from rona_core.geometry.surface.normals.normals import NormalField
from rona_core.session.document import Session

SEEDS = range(33_000, 33_120)
STEPS = (StartToolCapture(), StartPointerCapture(), StartSurfaceCapture(duration_s=40.0))
FACE_MM = 5.0  # radius of a probe's face
PLACES = 60  # of the cloud that are looked at


def judge(seed: int) -> list[Judged]:
    """Return errors and predicted sigmas of one session."""
    bench = bench_of(seed)
    try:
        for step in STEPS:
            bench.run(step)
        session = bench.session
    finally:
        bench.close()
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    return [
        *tips(session, truth, seed),
        *registration(session, truth, seed),
        *cloud(session, truth, seed),
        *normals(session, truth, seed),
    ]


def tips(session: Session, truth: Truth, seed: int) -> list[Judged]:
    """Return the calibrated tips of tool and pointer; of a 5D pointer along its line alone."""
    tool, pointer = session.results.tool, session.results.pointer
    if tool is None or pointer is None:
        return []
    scene = truth.scene
    off = tool.value.T_toolmarker_tip.translation - scene.T_tip_toolmarker.inv().translation
    parts = [principal_parts(off, tool.value.covariance[9:, 9:])]
    off = pointer.value.tip_pointermarker - scene.tips[pointer.value.pointer]
    spread = pointer.value.tip_covariance_pointermarker
    axes = slice(2, 3) if pointer.value.dof == 5 else slice(0, 3)
    parts.append(principal_parts(off[axes], spread[axes, axes]))
    return [
        Judged(name, "common", seed, errors, sigmas)
        for name, (errors, sigmas) in zip(("tool tip (mm)", "pointer tip (mm)"), parts, strict=True)
    ]


def registration(session: Session, truth: Truth, seed: int) -> list[Judged]:
    """Return the error of the middle of the region, mapped from tracker to base."""
    tool = session.results.tool
    if tool is None:
        return []
    found, true = tool.value.T_base_tracker, truth.scene.T_base_tracker
    middle_base = truth.landmarks_base()["middle"]
    middle_tracker = true.inv() @ middle_base
    J = point_jacobians(found, middle_tracker[None])[0]
    spread = J @ tool.value.covariance[:6, :6] @ J.T
    errors, sigmas = principal_parts(found @ middle_tracker - middle_base, spread)
    return [Judged("registration (mm)", "common", seed, errors, sigmas)]


def cloud(session: Session, truth: Truth, seed: int) -> list[Judged]:
    """Return how far the cloud lies off the bone as it lay in step 4, and off the true tip."""
    surface, predicted = session.results.surface, predict_surface(session)
    if surface is None or predicted is None:
        return []
    (stroke,), made = session.captures.surface, surface.value
    rows = np.searchsorted(made.times_s, stroke.marker.times_s[predicted.rows])
    rows = np.minimum(rows, len(made) - 1)
    kept = made.times_s[rows] == stroke.marker.times_s[predicted.rows]
    points = made.points_base[rows[kept]]
    distances, (_, normals) = truth.signed_distance_mm(points), truth.foot(points)
    mean = tip_errors(made, session.captures.surface, truth).mean(axis=0)

    def along(covariances: Floats) -> Floats:
        return np.sqrt(np.einsum("ni,nij,nj->n", normals, covariances[kept], normals))

    whole = Judged("cloud along normals (mm)", "whole", seed, distances, along(predicted.whole))
    rest, local = distances - normals @ mean, along(predicted.local)
    return [
        Judged("cloud, mean (mm)", "common", seed, *principal_parts(mean, predicted.common)),
        Judged("cloud along normals (mm)", "local", seed, rest, local, varies=True),
        whole,
    ]


def normals(session: Session, truth: Truth, seed: int) -> list[Judged]:
    """Return errors of the normals along two tangents, of those that are not refused."""
    surface = session.results.surface
    if surface is None:
        return []
    points = surface.value.points_base
    places = points[:: max(1, len(points) // PLACES)]
    found = NormalField(points).normals(places, viewpoint=required(VIEWPOINT, session))
    true = truth.face_normals(places, FACE_MM)
    tangents = np.linalg.svd(true[:, None])[2][:, 1:]
    turned = np.rad2deg(np.einsum("nki,ni->nk", tangents, found.normals))[found.ok]
    sigma = np.repeat(found.sigma_deg[found.ok, None] / np.sqrt(2.0), 2, axis=1)
    name = "normals over a face (deg)"
    return [Judged(name, "local", seed, turned.ravel(), sigma.ravel(), varies=True)]
