"""How sure it is where the probe was, and where the cloud: robot, holder, line, tracker."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.calibration.hand_eye.reference_markers import HeadMotion
from rona_core.calibration.timing.robot_latency import BREATH_MM
from rona_core.devices.robots import ROBOTS
from rona_core.devices.settings import TrackerProfile
from rona_core.devices.trackers import ACCURACY_MM
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.mapping.accuracy.error_terms import ErrorTerm
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.cloud_fusion import CloudPrior
from rona_core.mapping.probe_poses import ProbePostures
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import ROBOT_ACCURACY_MM, tip_sensitivities
from rona_core.ultrasound.acoustic_calibration.delay_line import NOMINAL_PER_K
from rona_core.ultrasound.acoustic_calibration.probe_mounting import ProbeMounting
from rona_core.ultrasound.probe.materials import GEL
from rona_core.ultrasound.probe.probe_model import ProbeModel

# As makers state it: mean distance of repeated arrivals from their middle, and three deviations of
# it (ISO 9283); 3.62 deviations along one axis where they scatter alike in all directions.
REPEATABILITY_OVER_SIGMA = 3.62
# Assumed, one standard deviation each: no source states them.
SEAT_MM = 0.4  # of a probe that was clamped by hand, along its axis
ROOM_K = 5.0  # of a line without a calibration, between room and skin
WARMING_K = 0.8  # of a line since it was asked, by the end of a scan
CREEP_MM = 0.2  # of a head in its clamp without a marker
# a line whose face is held warmer warms with the root of time (Carslaw 1959): mean, deviation of it
MEAN_WARMING, WARMING_SPREAD = 2.0 / 3.0, 18.0**-0.5
COUPLING_MM = 0.01  # film and speed of the gel under the face
WIDE_MM = 30.0  # what changes evenly over a whole map hangs together so far
TURN_ARM_MM = 100.0  # what errs by a millimetre over a shorter way turns a cloud by more
GAUGE = "record the probe on the gauge plate (step 8)"


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlace:
    """What carried the probe; ``terms`` of a map are its causes of error along the normal."""

    terms: tuple[ErrorTerm, ...]  # the same in all cells
    model: str | None = None  # of the robot; None: a hand
    qs_rad: Floats | None = None  # (n, 6) postures of the first pass

    def of_cells(self, maps: Maps) -> tuple[ErrorTerm, ...]:
        """Return the terms over the grid of maps."""
        if self.model is None or self.qs_rad is None:
            return self.terms
        return (*self.terms, _links(self.model, self.qs_rad, maps))


def robot_place(
    robot: str,
    postures: ProbePostures | None,
    probe: ProbeModel,
    mounting: ProbeMounting | None,
    line_sigma_us: float | None,
    head: HeadMotion | None,
) -> ProbePlace:
    """Return the place of a probe that a robot carries.

    Args:
        robot: Its model.
        postures: Of the first pass.
        probe: As it is known.
        mounting: Found on the gauge plate.
        line_sigma_us: Of a line that was calibrated on the block.
        head: Its motion during the first pass; None where it was not measured.
    """
    # a late echo of the face counts as a longer way through the gel
    mm_per_us = GEL.speed_mm_per_us / 2.0
    mm_per_k = probe.line_delay_us * NOMINAL_PER_K * mm_per_us
    warming_mm = WARMING_K * mm_per_k
    line = ErrorTerm("delay line", shared_mm=ROOM_K * mm_per_k, remedy=GAUGE)
    if mounting is not None or line_sigma_us is not None:
        known_mm = (line_sigma_us or 0.0) * mm_per_us if mounting is None else 0.0
        line = ErrorTerm(
            "delay line",
            own_mm=WARMING_SPREAD * warming_mm,  # it warms while the probe moves on
            shared_mm=float(np.hypot(MEAN_WARMING * warming_mm, known_mm)),
            remedy="let the line warm up on the head first",
            reach_mm=WIDE_MM,
        )
    seat = ErrorTerm("mounting of the probe", shared_mm=SEAT_MM, remedy=GAUGE)
    if mounting is not None:
        seat = ErrorTerm("mounting of the probe", shared_mm=mounting.sigma_mm)
    terms = (
        _head(head),
        ErrorTerm("repeatability of the robot", own_mm=repeatability_mm(robot)),
        ErrorTerm("coupling", shared_mm=COUPLING_MM),
        seat,
        line,
    )
    return ProbePlace(terms, robot, None if postures is None else postures.qs_rad)


def repeatability_mm(robot: str) -> float:
    """Return the standard deviation along one axis with which a robot comes again."""
    stated = {name: one.repeatability_mm for name, one in ROBOTS.items()}
    return stated.get(robot, max(stated.values())) / REPEATABILITY_OVER_SIGMA


def _head(motion: HeadMotion | None) -> ErrorTerm:
    """Return the term of the head: what the noise of its marker leaves, or what clamps allow."""
    if motion is None:
        remedy = "put a marker on the head"
        return ErrorTerm("head motion", BREATH_MM, CREEP_MM, remedy=remedy)
    known_mm = float(np.linalg.norm(motion.sigma_at(motion.center_base))) / 3.0**0.5
    return ErrorTerm("head motion", BREATH_MM, known_mm)


def cloud_prior(tracker: TrackerProfile, registration_mm: float, tip_mm: float) -> CloudPrior:
    """Return how far off the pointer's cloud may be as a whole, against maps by the robot.

    Args:
        tracker: Its model.
        registration_mm: 3D standard deviation of the registration of the tracker.
        tip_mm: The same of the tip of the pointer.
    """
    sigmas_mm = (ACCURACY_MM[tracker], ROBOT_ACCURACY_MM, registration_mm, tip_mm)  # 3D
    shift_mm = float(np.linalg.norm(sigmas_mm)) / 3.0**0.5
    return CloudPrior(shift_mm, shift_mm / TURN_ARM_MM)


def hand_place(
    tracker: TrackerProfile, face_mm: float, registration_mm: float | None
) -> ProbePlace:
    """Return the place of a tracked probe in the hand.

    The tracker sees the marker of the probe and that on the robot base, both as well as its maker
    states. Where the maps are in ``base``, the registration of the robot takes the place of the
    second one.

    Args:
        tracker: Its model.
        face_mm: 3D standard deviation of the calibrated face of the probe.
        registration_mm: The same of the registration; None where the maps are not in ``base``.
    """
    tracker_mm = ACCURACY_MM[tracker]
    sigmas_mm = [
        ("tracker", 2.0**0.5 * tracker_mm if registration_mm is None else tracker_mm),
        ("calibration of the probe", face_mm),
    ]
    if registration_mm is not None:
        sigmas_mm.append(("registration", registration_mm))
    return ProbePlace(
        tuple(
            ErrorTerm(cause, shared_mm=sigma_mm / 3.0**0.5, of_robot=True)
            for cause, sigma_mm in sigmas_mm
        )
    )


def _nearest(places: Floats, boundary: BoundaryMap) -> Ints:
    """Return the place (n, 2) in ``map`` that is nearest to each cell (nu nv,)."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.asarray(KDTree(places).query(np.column_stack((u.ravel(), v.ravel())))[1])


def _links(name: str, qs_rad: Floats, maps: Maps) -> ErrorTerm:
    """Return what the links of the robot do to the cells of a map, posture by posture."""
    boundary = maps.outer
    points = boundary.T_base_map.inv() @ maps.outer_points_base[: len(qs_rad)]
    model = robot_model(name)
    axes = (model.forward(qs_rad) @ model.T_flange_probe).rotations[:, :, 2]
    rows = tip_sensitivities(model, qs_rad, -axes, ROBOT_ACCURACY_MM)
    rows = rows[_nearest(points[:, :2], boundary)]
    ok: Bools = boundary.ok.ravel()
    middle = rows[ok].mean(axis=0) if ok.any() else rows.mean(axis=0)
    own = np.linalg.norm(rows - middle, axis=1).reshape(boundary.ok.shape)
    return ErrorTerm(
        "links of the robot",
        own_mm=own,
        shared_mm=float(np.linalg.norm(middle)),
        of_robot=True,
        reach_mm=WIDE_MM,
        remedy="calibrate the arm, or let the robot that scanned use the map",
    )
