"""Surveys of simulated patients, fired again at the same places into bone of another kind or loss.

``scanned`` carries out the procedure up to the robot's scan; ``stood_on`` puts the probe on the
bone without a robot, which is quicker. The places stay as they are: what changes is the bone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.declarations.declarations import Message
from rona_core.app.procedure import Stages, run_procedure, stages
from rona_core.app.steps.boundaries.ascan_view import scan_poses
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import new_workbench, specimen_of
from rona_core.devices.settings import ProbeSettings
from rona_core.devices.world_settings import NOMINAL_WORLD
from rona_core.errors import StepBlockedError
from rona_core.evaluation.scan_metrics import true_probe_poses
from rona_core.evaluation.truth import Truth
from rona_core.geometry.pose import Poses
from rona_core.session.document import Session
from rona_core.session.specimen import BoneChoice, BoneKind
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey
from rona_core.virtual.acoustics.medium import bone_medium
from rona_core.virtual.acoustics.probe import Layered
from rona_core.virtual.rig import build_scene
from rona_core.virtual.specimen.simulated.simulated_skull import SimulatedSpecimen
from rona_core.virtual.world.world import NOMINAL, draw_world
from tests.scenes.bone_record import BoneScene, record
from tests.scenes.bone_scenes import standing_meander

STANDING_STREAM = 0x57A4D  # names the draw of leans and heights of a probe that no robot holds
UP_TO_SCAN = stages("scan")


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Where the probe stood in one scan of one patient, in truth and as the robot says."""

    seed: int
    specimen: Layered
    settings: ProbeSettings
    Ts_skull_probe: Poses  # true ones
    Ts_base_probe: Poses  # as the robot's joint angles have them


def scanned(seed: int, among: Stages = UP_TO_SCAN, before: Sequence[Message] = ()) -> Survey:
    """Return the survey of one patient after one pass of the robot.

    Args:
        seed: Of the patient.
        among: Stages of the procedure, the scan the last of them.
        before: Commands that are sent before them.

    Raises:
        StepBlockedError: the procedure did not get as far as the scan.
    """
    bench = new_workbench(Session(name=f"survey, seed {seed}"))
    try:
        for command in (SetSeed(seed), *before):
            bench.dispatch(command)
        ending = run_procedure(bench, among)
        scan, believed = bench.session.captures.scan, scan_poses(bench.session)
        if not ending.completed or scan is None or believed is None:
            raise StepBlockedError(f"seed {seed} has no scan: {ending.reason}")
        setup = bench.session.setup
        scene = build_scene(setup.seed, specimen_of(setup), setup.devices, NOMINAL)
        T_skull_base = scene.T_base_skull.inv()
        true = [T_skull_base @ pose for pose in true_probe_poses(scan, Truth(scene))]
        return Survey(seed, scene.specimen, setup.devices.probe, Poses.stack(true), believed)
    finally:
        bench.close()


def stood_on(seed: int, radius_mm: float, lines_mm: float = 4.0) -> Survey:
    """Return a survey of one patient's region whose places are known exactly."""
    specimen, settings = SimulatedSpecimen(seed), ProbeSettings()
    poses, _ = standing_meander(
        specimen,
        np.random.default_rng((seed, STANDING_STREAM)),
        radius_mm=radius_mm,
        pitch_mm=settings.pitch_mm,
        lines_mm=lines_mm,
    )
    places = Poses.stack(poses)
    return Survey(seed, specimen, settings, places, places)


def fired_again(survey: Survey, kind: BoneKind = "normal", loss: float = 1.0) -> BoneScene:
    """Return the A-scans of this survey in bone of a kind, its loss times a factor."""
    medium = bone_medium(draw_world(NOMINAL_WORLD, BoneChoice(kind), survey.seed))
    table, diploe = (
        replace(m, attenuation_db_per_cm=loss * m.attenuation_db_per_cm)
        for m in (medium.table, medium.diploe)
    )
    n = len(survey.Ts_skull_probe)
    return record(
        f"seed {survey.seed}, {kind}, loss x{loss:g}",
        survey.specimen,
        replace(medium, table=table, diploe=diploe),
        survey.settings,
        [survey.Ts_skull_probe[i] for i in range(n)],
        np.column_stack((np.zeros(n, dtype=np.int64), np.arange(n))),
        survey.settings.pitch_mm,
        survey.seed,
    )


def detected(survey: Survey, scene: BoneScene) -> Detection:
    """Return what detection makes of a survey, told what the robot knows of its places."""
    return detect(
        ProbeSurvey(
            scene.track,
            scene.probe,
            scene.settings.excitation,
            positions_mm=survey.Ts_base_probe.translations,
            axes=survey.Ts_base_probe.rotations[:, :, 2],
        )
    )
