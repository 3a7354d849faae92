"""Surveys of whole scans, fired again at the same places into other bone.

One robot scan is planned and carried out for each patient, with the bone that a session has by
default. Then the virtual probe fires again at the true poses of that scan, into bone of another
kind or with another loss: as long as the places are the same, what changes is the bone.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.bone_record import BoneScene, record
from rona_core.app.messages import SetSeed
from rona_core.app.procedure import PROCEDURE, run_procedure
from rona_core.app.scan_views import scan_poses
from rona_core.compose import new_workbench
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import StepBlockedError
from rona_core.evaluation.scan_figures import true_probe_poses
from rona_core.evaluation.truth import Truth
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.document import Session
from rona_core.session.specimen import BoneChoice, BoneKind
from rona_core.ultrasound.detect import Detection, detect
from rona_core.virtual.bone_medium import bone_medium
from rona_core.virtual.probe import Layered

UP_TO_SCAN = PROCEDURE[: 1 + [step for step, _ in PROCEDURE].index("scan")]


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Where the probe stood in one scan of one patient, in truth and as the robot says."""

    seed: int
    specimen: Layered
    settings: ProbeSettings
    Ts_skull_probe: Poses  # true ones
    Ts_base_probe: Poses  # as the robot's joint angles have them


def scanned(seed: int) -> Survey:
    """Return the survey of one patient after one pass of the robot.

    Raises:
        StepBlockedError: the procedure did not get as far as the scan.
    """
    bench = new_workbench(Session(name=f"survey, seed {seed}"))
    try:
        bench.dispatch(SetSeed(seed))
        ending = run_procedure(bench, messages=UP_TO_SCAN)
        scan, believed = bench.session.captures.scan, scan_poses(bench.session)
        if not ending.completed or scan is None or believed is None:
            raise StepBlockedError(f"seed {seed} has no scan: {ending.reason}")
        truth = Truth(bench.rig().scene)
        T_skull_base = truth.scene.T_base_skull.inv()
        true = [T_skull_base @ pose for pose in true_probe_poses(scan, truth)]
        settings = bench.session.setup.devices.probe
        return Survey(seed, truth.scene.specimen, settings, Poses.stack(true), believed)
    finally:
        bench.close()


def fired_again(survey: Survey, kind: BoneKind = "normal", loss: float = 1.0) -> BoneScene:
    """Return the A-scans of this survey in bone of a kind, its loss times a factor."""
    medium = bone_medium(BoneChoice(kind), survey.seed)
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
        scene.track,
        scene.probe,
        scene.settings.excitation,
        positions_mm=survey.Ts_base_probe.translations,
        axes=survey.Ts_base_probe.rotations[:, :, 2],
    )
