"""Thickness of A-scans and speed of sound, with the published speed and with reference points.

A probe stands on the bone of a patient of the realistic world, a millimetre apart in rows 4 mm
apart, off the normal by 1 degree, clamped as that world has it; a caliper measures at the places
that the program proposes. *Common* is the mean over the region, *local* what a place differs by
from it, once what the mean speed does to its thickness is taken off: the speed that all places
share errs more where bone is thick, and its sigma says so. A-scans that took another echo (1 mm
off and more) are left out: ``bone_kinds`` has them. Tuned were limits and priors on seeds 10000 to
10109 and 45000 to 45119, where the split was looked at as well.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.suites.honesty.judged import Judged
from rona_core.app.steps.setup.messages import SetSeed, SetWorld
from rona_core.compose import new_workbench, world_of
from rona_core.devices.samples import AScan, AScanTrack
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import LocatedDetection, boundary_points
from rona_core.mapping.echo_depths import echo_depths
from rona_core.session.document import Session, Setup
from rona_core.ultrasound.acoustic_calibration.reference_points import (
    lags_at,
    propose_references,
    speed_prior_for,
)
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    calibrate_speed,
    speed_at,
    speed_uncertainty,
    uncalibrated,
)
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from rona_core.virtual.acoustics.medium import bone_medium, true_bone
from rona_core.virtual.acoustics.plates import VirtualBench
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.rig import build_scene
from rona_core.virtual.specimen.simulated.simulated_skull import SimulatedSpecimen
from tests.scenes.bone_record import PERIOD_S
from tests.scenes.bone_scenes import standing_meander
from tests.scenes.bone_surveys import STANDING_STREAM

SEEDS = (*range(46_000, 46_120), *range(46_200, 46_320), *range(47_000, 47_120))
POINTS = (0, 3, 5)
RADIUS_MM, LINES_MM = 25.0, 4.0
WRONG_MM = 1.0
LEAST_SURE = 20  # A-scans that make a map


@dataclass(frozen=True, slots=True, eq=False)
class Patient:
    """A-scans (n,) of one patient with the truth beside them; places are in ``base``, mm."""

    seed: int
    detection: Detection
    places_base: Floats  # (n, 3)
    poses: Poses  # (n,) of the probe, as told
    thickness_mm: Floats  # (n,) true, along the axis
    speed_mm_per_us: Floats  # (n,) true
    bench: VirtualBench
    centre_mhz: float  # of the probe

    @property
    def right(self) -> Bools:
        """Which of the sure A-scans took the right echo."""
        sure, detection = self.detection.inner_ok, self.detection
        share = detection.sound_speed_mm_per_us / self.speed_mm_per_us[sure]
        off = detection.thickness_mm[sure] - self.thickness_mm[sure] * share
        return np.abs(off) < WRONG_MM


@dataclass(frozen=True, slots=True, eq=False)
class ThicknessErrors:
    """Errors of the thickness of A-scans (n,), found minus true, and their sigmas; all in mm."""

    whole_mm: Floats
    local_mm: Floats  # what the place has for itself; their mean is 0
    common_sigma_mm: Floats
    local_sigma_mm: Floats


def judge(seed: int) -> Iterator[Judged]:
    """Yield errors and sigmas of thickness and speed, with no reference point, three and five."""
    patient = surveyed(seed)
    if int(patient.detection.inner_ok.sum()) < LEAST_SURE:
        raise DegenerateGeometryError(
            f"seed {seed}: hardly an A-scan is sure of its inner boundary"
        )
    for points in POINTS:
        known = calibrated(patient, points) if points else uncalibrated()
        yield from thicknesses(patient, known, f"{points} reference points")
        if known.verdict == "good":
            error = known.speed_mm_per_us / mean_speed(patient) - 1.0
            name = f"speed called good, {points} reference points (%)"
            both = np.array([100.0 * error]), np.array([100.0 * known.share])
            yield Judged(name, "common", seed, *both)


def thicknesses(patient: Patient, known: SpeedCalibration, way: str) -> Iterator[Judged]:
    """Yield errors and sigmas of the thickness of sure A-scans: common, local and both."""
    found = thickness_errors(patient, known)
    common, local = found.common_sigma_mm, found.local_sigma_mm
    name = f"thickness of A-scans, {way} (mm)"
    # one speed for all: the mean over the places feels the mean of what it does to each
    mean, shared = np.array([found.whole_mm.mean()]), np.array([common.mean()])
    yield Judged(name, "common", patient.seed, mean, shared)
    yield Judged(name, "local", patient.seed, found.local_mm, local, varies=True)
    yield Judged(name, "whole", patient.seed, found.whole_mm, np.hypot(common, local))


def thickness_errors(patient: Patient, known: SpeedCalibration) -> ThicknessErrors:
    """Return the errors of sure A-scans that took the right echo, and the sigmas for them."""
    detection, sure, right = patient.detection, patient.detection.inner_ok, patient.right
    places = patient.places_base[sure]
    speed = speed_at(known, places)[0]
    shared, own = speed_uncertainty(known, places)
    depth = detection.thickness_mm[sure] * speed / detection.sound_speed_mm_per_us
    errors = (depth - patient.thickness_mm[sure])[right]
    mean_off = float((speed - patient.speed_mm_per_us[sure]).mean())  # alike for the region
    rest = errors - (depth * mean_off / speed)[right]
    return ThicknessErrors(
        whole_mm=errors,
        local_mm=rest - rest.mean(),
        common_sigma_mm=(depth * shared)[right],
        local_sigma_mm=np.hypot(depth * own, detection.thickness_sigma_mm[sure])[right],
    )


def mean_speed(patient: Patient) -> float:
    """Return the true mean speed over the places of the sure A-scans, in mm/us."""
    return float(patient.speed_mm_per_us[patient.detection.inner_ok].mean())


def calibrated(patient: Patient, points: int) -> SpeedCalibration:
    """Return the calibration at proposed places; the prior where none can be had, or a bad one."""
    depths = echo_depths(LocatedDetection(patient.detection, patient.poses))
    try:
        rows = propose_references(depths, points).rows
        places = depths.places_base[rows]
        lag_us, sigma_us = lags_at(places, depths)
    except (DegenerateGeometryError, InvalidInputError):
        return uncalibrated()
    caliper_mm, sigma_mm = patient.bench.measure_thickness(places, depths.axes_base[rows])
    known = calibrate_speed(
        caliper_mm,
        lag_us,
        thickness_sigma_mm=sigma_mm,
        lag_sigma_us=sigma_us,
        positions_mm=places,
        region_mm=depths.places_base,
        prior=speed_prior_for(depths, patient.centre_mhz),
    )
    return uncalibrated() if known.verdict == "bad" else known


def surveyed(seed: int) -> Patient:
    """Return the A-scans of a patient of the realistic world, detected as in a session."""
    setup = _setup(seed)
    settings, world = setup.devices.probe, world_of(setup)
    specimen = SimulatedSpecimen(seed, relief=world.relief)
    scene = build_scene(seed, specimen, setup.devices, world)
    medium = bone_medium(world)
    standing, _ = standing_meander(
        specimen,
        np.random.default_rng((seed, STANDING_STREAM)),
        radius_mm=RADIUS_MM,
        pitch_mm=settings.pitch_mm,
        lines_mm=LINES_MM,
    )
    clock, here = CaptureClock(), [standing[0]]
    probe = VirtualProbe(
        clock, lambda times: here[0].repeated(len(times)), specimen, medium, world=world
    )
    probe.begin(settings, seed, 0)
    scans: list[AScan] = []
    for number, pose in enumerate(standing):
        here[0] = pose @ world.clamping
        clock.wait_until(PERIOD_S * (number + 1))
        scans.append(probe.acquire())
    told = Poses.stack([scene.T_base_skull @ pose for pose in standing])
    true = Poses.stack([scene.T_base_skull @ pose @ world.clamping for pose in standing])
    axes = told.rotations[:, :, 2]
    track, model = AScanTrack.from_scans(scans), probe_model(settings)
    found = detect(
        ProbeSurvey(track, model, settings.excitation, positions_mm=told.translations, axes=axes)
    )
    speed, depth = true_bone(true, scene, medium)
    places = boundary_points(found, told)[0]
    bench, centre_mhz = VirtualBench(scene), model.centre_mhz
    return Patient(seed, found, places, told, depth, speed, bench, centre_mhz)


def _setup(seed: int) -> Setup:
    bench = new_workbench(Session(name=f"thickness, seed {seed}"))
    try:
        bench.dispatch(SetSeed(seed))
        bench.dispatch(SetWorld(profile="realistic"))
        return bench.session.setup
    finally:
        bench.close()
