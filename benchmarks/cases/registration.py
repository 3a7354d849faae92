"""Registration of robot and tracker, of points and of surfaces, and the predicted error of the map.

Peers are optional: OpenCV's calibrateRobotWorldHandEye and scikit-surgerycore's prediction of TRE.
"""

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.cases.registration_worlds import (
    STEREO,
    TARGETS_BASE,
    TIP_BASE,
    ToolWorld,
    looking,
    skull_patch,
    skull_points,
    tool_world,
    tracked,
)
from benchmarks.metric import Metric, Progress
from benchmarks.reference.paired_point_registration import register_fiducials
from benchmarks.reference.yardstick import beside_peer
from rona_core.calibration.error_propagation import MapSetup, predict_map_error
from rona_core.calibration.hand_eye.hand_eye import solve_hand_eye
from rona_core.calibration.hand_eye.tool_registration import solve_paper
from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.surface_registration import point_surface, register_surface
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import point_jacobians
from rona_core.geometry.rigid_fit import register_points

TRIALS = 300
REGISTRATION_S = 0.06  # on the machine that yardsticks are told by
MAPS, PIVOT_FRAMES, PLACES = 60, 300, 40
SURFACES = 12
LOST_MM = 1e3  # what counts where a method finds nothing

Registration = Callable[[ToolWorld], Pose]


def registration_metrics(progress: Progress) -> list[Metric]:
    """Return all figures of this file."""
    return [
        *robot_tracker(progress),
        *point_registration(progress),
        *map_error(progress),
        *surface_registration(progress),
    ]


def tre_mm(T_base_tracker: Pose, world: ToolWorld) -> float:
    """Return the RMS error of mapping five places on the skull."""
    targets_tracker = world.T_base_tracker.inv() @ TARGETS_BASE
    off = T_base_tracker @ targets_tracker - TARGETS_BASE
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def joint(world: ToolWorld) -> Pose:
    """Return RONA's registration."""
    return solve_hand_eye(world.Ts_base_tip, world.Ts_tracker_toolmarker).T_base_tracker


def paper(world: ToolWorld) -> Pose:
    """Return the registration by a sphere and two lines."""
    return solve_paper(world.Ts_base_tip, world.Ts_tracker_toolmarker, world.phases).T_base_tracker


def opencv(name: str) -> Registration | None:
    """Return a method of OpenCV's, None where it is not installed."""
    try:
        cv2: Any = importlib.import_module("cv2")
        method = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
    except (ImportError, AttributeError):
        return None

    def solve(world: ToolWorld) -> Pose:
        seen, robot = world.Ts_tracker_toolmarker, world.Ts_base_tip
        # A X = Z B with A = T_tracker_toolmarker, X = T_toolmarker_tip, Z = T_tracker_base
        _, _, rotation, translation = cv2.calibrateRobotWorldHandEye(
            list(seen.rotations),
            list(seen.translations),
            list(robot.rotations),
            list(robot.translations),
            method=method,
        )
        u, _, vt = np.linalg.svd(np.asarray(rotation))
        return Pose(u @ vt, np.asarray(translation).ravel()).inv()

    return solve


def robot_tracker(progress: Progress) -> list[Metric]:
    """Return TRE over trials of all methods, honesty of the covariance, and time."""
    progress(f"{TRIALS} registrations of robot and tracker, with and without gross errors")
    peers = {
        "paper": paper,
        "OpenCV Shah": opencv("SHAH"),
        "OpenCV Li": opencv("LI"),
    }
    metrics: list[Metric] = []
    for share, goal in ((0.0, 0.14), (0.05, 0.15)):
        worlds = [tool_world(np.random.default_rng((3, i)), gross=share) for i in range(TRIALS)]
        errors = [tre_mm(joint(world), world) for world in worlds]
        case = "5 % gross errors" if share else "clean"
        label = f"robot/tracker TRE, 50 poses, {case}"
        for name, method in peers.items():
            value = None if method is None else float(np.median(attempts(method, worlds)))
            metrics.append(
                Metric(
                    f"{label} (median), beside {name}",
                    float(np.median(errors)),
                    "mm",
                    "lower",
                    goal,
                    name,
                    value,
                )
            )
        metrics.append(Metric(f"{label} (95 %)", float(np.quantile(errors, 0.95)), "mm", "lower"))
        nees = float(np.mean([squared_error(world) for world in worlds]))
        metrics.append(
            Metric(f"NEES / 3 of a skull point, {case}, off 1", abs(nees - 1), "", "lower", 0.25)
        )
    world = tool_world(np.random.default_rng(3))
    shah = peers["OpenCV Shah"]
    metrics.append(
        beside_peer(
            "robot/tracker registration, 50 poses, CPU",
            lambda: joint(world),
            REGISTRATION_S,
            "OpenCV Shah" if shah else None,
            (lambda: shah(world)) if shah else None,
        )
    )
    return metrics


def attempts(method: Registration, worlds: list[ToolWorld]) -> list[float]:
    """Return the TRE of a method over worlds, LOST_MM where it refuses."""
    found: list[float] = []
    for world in worlds:
        try:
            found.append(tre_mm(method(world), world))
        except RonaError:
            found.append(LOST_MM)
    return found


def squared_error(world: ToolWorld) -> float:
    """Return the squared error of one skull point in units of its predicted covariance, over 3."""
    fit = solve_hand_eye(world.Ts_base_tip, world.Ts_tracker_toolmarker)
    target_tracker = world.T_base_tracker.inv() @ TARGETS_BASE[1]
    J = point_jacobians(fit.T_base_tracker, target_tracker[None])[0]
    off = fit.T_base_tracker @ target_tracker - TARGETS_BASE[1]
    return float(off @ np.linalg.solve(J @ fit.covariance[:6, :6] @ J.T, off)) / 3.0


def point_registration(progress: Progress) -> list[Metric]:
    """Return how far predicted TRE is from a simulation, near the origin and 1.9 m off."""
    progress("prediction of TRE against a simulation")
    fiducials = np.array(((0, 0, 0), (90.0, 10, 0), (30, 70, 20), (-40, 50, -30)))
    fiducials -= fiducials.mean(axis=0)
    target, sigma_mm, draws = np.array((60.0, -40.0, 90.0)), 0.2, 6000
    try:
        peer = importlib.import_module("sksurgerycore.algorithms.errors").compute_tre_from_fle
    except ImportError:
        peer = None
    metrics: list[Metric] = []
    for place, shift in (("at the origin", (0.0, 0, 0)), ("1.9 m off", (50.0, -30, -1900))):
        rng = np.random.default_rng(4)
        points, goal_point = fiducials + shift, target + shift
        noise = rng.normal(0.0, sigma_mm, (draws, *points.shape))
        misses = [
            register_points(points, points + e).T_b_a @ goal_point - goal_point for e in noise
        ]
        simulated = float(np.sqrt((np.array(misses) ** 2).sum(axis=1).mean()))
        known = register_fiducials(points, points, covariances=sigma_mm**2 * np.eye(3))
        ours = float(known.target_errors_mm(goal_point[None])[0])
        theirs = None
        if peer is not None:
            theirs = float(np.sqrt(peer(points, 3.0 * sigma_mm**2, goal_point[None])))
        metrics.append(
            Metric(
                f"TRE predicted over simulated, {place}, off 1",
                abs(ours / simulated - 1.0),
                "",
                "lower",
                0.03,
                "scikit-surgerycore" if peer else None,
                None if theirs is None else abs(theirs / simulated - 1.0),
            )
        )
    return metrics


def map_error(progress: Progress) -> list[Metric]:
    """Return how far the predicted error of the map is from repeating everything."""
    progress(f"{MAPS} maps, each with its own registration and pivot")
    metrics: list[Metric] = []
    for n_averaged in (1, 5):
        squares: list[float] = []
        expected: list[float] = []
        for i in range(MAPS):
            rng = np.random.default_rng((5, n_averaged, i))
            simulated, predicted = one_map(rng, n_averaged)
            squares.append(simulated)
            expected.append(predicted)
        rms = float(np.sqrt(np.mean(squares)))
        ratio = float(np.sqrt(np.mean(expected))) / rms
        case = f"{n_averaged} frame{'s' if n_averaged > 1 else ''} a place"
        metrics += [
            Metric(f"map error, {case} (RMS)", rms, "mm", "lower"),  # the tracker's noise sets it
            Metric(
                f"map error predicted over simulated, {case}, off 1",
                abs(ratio - 1.0),
                "",
                "lower",
                0.1,
            ),
        ]
    return metrics


def one_map(rng: np.random.Generator, n_averaged: int) -> tuple[float, float]:
    """Return mean squared error of touched places, and the predicted one, mm^2."""
    world = tool_world(rng)
    fit = solve_hand_eye(world.Ts_base_tip, world.Ts_tracker_toolmarker)
    geometry = GEOMETRIES["pointer6d"]
    tip = geometry.nominal_tip_marker
    T_base_tracker = world.T_base_tracker
    upright = looking(T_base_tracker.rotation[:, 2], TIP_BASE, rng)  # plate towards the tracker
    R_tracker_pointermarker = T_base_tracker.rotation.T @ upright.rotation @ np.diag((1.0, -1, -1))

    def touching(places_tracker: Floats, spread_deg: float) -> Poses:
        n = len(places_tracker)
        turns = np.deg2rad(spread_deg) * np.sqrt(rng.uniform(0, 1, (n, 1)))
        ways = rng.normal(size=(n, 3))
        vectors = turns * ways / np.linalg.norm(ways, axis=1)[:, None]
        rotations = R_tracker_pointermarker @ Rotation.from_rotvec(vectors).as_matrix()
        return Poses(rotations, places_tracker - rotations @ tip)

    dimple = np.repeat((T_base_tracker.inv() @ TIP_BASE)[None], PIVOT_FRAMES, axis=0)
    sweep = tracked(touching(dimple, 20.0), "pointer6d", STEREO, rng)
    pivot = calibrate_pointer(
        sweep, pointer="pointer6d", dof=6, positions_pointermarker=geometry.positions_marker
    )
    places_base = TIP_BASE + rng.uniform(-60.0, 60.0, (PLACES, 3))
    pointer = touching(T_base_tracker.inv() @ places_base, 20.0)
    frames = [tracked(pointer, "pointer6d", STEREO, rng) for _ in range(n_averaged)]
    tips = np.mean([frame @ pivot.tip_pointermarker for frame in frames], axis=0)
    off = fit.T_base_tracker @ tips - places_base
    setup = MapSetup(
        T_base_tracker=fit.T_base_tracker,
        registration=fit.covariance,
        tip_pointermarker=pivot.tip_pointermarker,
        tip_covariance=pivot.tip_sigma_mm**2 / 3.0 * np.eye(3),
        positions_pointermarker=geometry.positions_marker,
        noise=STEREO,
        n_averaged=n_averaged,
    )
    predicted = predict_map_error(setup, frames[0])
    return float((off**2).sum(axis=1).mean()), predicted.rms_mm**2


def surface_registration(progress: Progress) -> list[Metric]:
    """Return TRE of a wide patch, and how often a small round one is flagged."""
    progress(f"{SURFACES} registrations to a surface")
    surface = point_surface(*skull_points())
    targets = np.array(((0, 0, 0), (60.0, 0, 30), (-50, 20, 30), (0, 70, 20), (10, -60, 40)))
    errors: list[float] = []
    flagged: list[bool] = []
    for i in range(SURFACES):
        rng = np.random.default_rng((6, i))
        start = Pose.from_rotvec(
            np.deg2rad(6.0) * unit(rng.normal(size=3)), 6.0 * unit(rng.normal(size=3))
        )
        found = register_surface(skull_patch(rng, 500, 70.0, 0.05), surface, start=start)
        errors.append(float(np.sqrt(((found.T_b_a @ targets - targets) ** 2).sum(axis=1).mean())))
        small = register_surface(skull_patch(rng, 100, 35.0, 0.0), surface, start=start)
        flagged.append(small.verdict != "good")
    return [
        Metric(
            "surface TRE, 500 points over 70 degrees, 5 % gross errors (median)",
            float(np.median(errors)),
            "mm",
            "lower",
            0.2,
        ),
        Metric("patches of 35 degrees flagged", float(np.mean(flagged)), "share", "higher", 1.0),
    ]


def unit(vector: Floats) -> Floats:
    """Return a vector of length 1 along ``vector``."""
    return vector / np.linalg.norm(vector)
