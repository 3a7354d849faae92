"""The smallest case of every suite: seconds, to see that it runs; its figures tell nothing."""

import importlib
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from rona_core.app.procedure import run_procedure, stages
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.setup.messages import SetRegion, SetWorld
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.devices.world_settings import WorldSettings
from rona_core.session.document import Session
from tests.scenes.bone_surveys import scanned
from tests.scenes.laboratory.families import FAMILIES
from tests.scenes.tank_recordings import CASES

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"
ONCE = {"metric.REPEATS": 1}
# all nine steps over a small region, with short captures: half the time of the whole procedure, and
# a value for every figure of the suites that the whole one has
REGION = SetRegion(radius_mm=14.0)
MESSAGES = (
    StartToolCapture(n_pivot=12, n_translate=4),
    StartPointerCapture(duration_s=6.0),
    StartSurfaceCapture(duration_s=25.0),
    StartPathCapture(duration_s=15.0, spacing_mm=5.0),
    StartRollSearch(n_rolls=24),
)
UP_TO_SCAN = stages("scan", *MESSAGES, skip=("gauge",))
ONE_PASS = stages("detection", *MESSAGES, skip=("gauge",))
SHORT = stages("maps", *MESSAGES, skip=("gauge", "caliper"))
small_survey = partial(scanned, among=UP_TO_SCAN, before=(REGION,))


def small_workbench(session: Session) -> Workbench:
    """Return a workbench whose region is small, in the place of ``new_workbench``."""
    bench = new_workbench(session)
    bench.dispatch(REGION)
    return bench


def short_procedure(seed: int, world: WorldSettings) -> tuple[Session, dict[str, Any]]:
    """Carry out the short procedure in the place of ``rona_core.compose.run_demo``."""
    bench = small_workbench(Session(name=f"short, seed {seed}"))
    bench.dispatch(SetWorld(**asdict(world)))
    try:
        ending = run_procedure(bench, SHORT)
        return bench.session, {**bench.figures(), "completed": ending.completed}
    finally:
        bench.close()


# suite -> constant of a module of the benchmarks -> its value in the smallest case
SMALLEST: Mapping[str, Mapping[str, Any]] = {
    "navigation": {
        **ONCE,
        "suites.navigation.navigation.TRIALS": 2,
        "cases.registration.TRIALS": 3,
        "cases.registration.MAPS": 2,
        "cases.registration.SURFACES": 1,
        "cases.pivot_sweeps.TRIALS": 4,
        "cases.pointer_map.SEEDS": (),
    },
    "base_marker": {"suites.navigation.base_marker.TRIALS": 3},
    "hand_eye": {"suites.navigation.hand_eye.SEEDS": range(46_000, 46_002)},
    "path": {
        **ONCE,
        "suites.navigation.path.SEEDS": range(1),
        "suites.navigation.path.FAST_SEEDS": range(1),
        "suites.navigation.path.FAST_POINTS": 900,
        "suites.navigation.path.LONG_POINTS": 1500,
        "suites.navigation.path.GREEDY_TRIALS": 1,
        "suites.navigation.path.BRUTE_TRIALS": 1,
        "cases.surface_normals.SEEDS": (),
        "cases.surface_normals.LARGE_POINTS": 10_000,
        "cases.surface_normals.PLANE_POINTS": 12_000,
        "cases.surface_normals.PATHS": 1,
    },
    "robot": {
        **ONCE,
        "suites.robot.robot.RESIDUAL_POSES": 400,
        "suites.robot.robot.POSES": 400,
        "suites.robot.robot.FORWARD_POSES": 200,
        "suites.robot.robot.PEER_POSES": 200,  # Newton takes 200 of them
    },
    "roll": {
        **ONCE,
        "suites.robot.roll.LONG_SCENES": ("S0",),
        "suites.robot.roll.TRAVEL_RAD": {("S0", 90): 8.401},
    },
    "timing": {
        **ONCE,
        "suites.robot.timing.FEASIBLE_SCENES": ("S0",),
        "suites.robot.timing.SPEEDS": (50.0, 20.0),
    },
    "collision": {
        **ONCE,
        "suites.robot.collision.CONFIGURATIONS": 50,
        "suites.robot.collision.HEADS": 1,
    },
    "base_placement": {**ONCE, "suites.robot.base_placement.SCENES": ("S0",)},
    "contact": {
        **ONCE,
        "suites.robot.contact.STIFFNESSES": (2.0,),
        "suites.robot.contact.TRIALS": 2,
    },
    "echo_model": {
        **ONCE,
        "suites.ultrasound.echo_model.STRIPS": ("1mhz_flat",),
        "suites.ultrasound.echo_model.FINER": "none",
        "suites.ultrasound.echo_model.LEANS_DEG": (3.0,),
        "suites.ultrasound.echo_model.BONES": 1,
        "suites.ultrasound.echo_model.ROUNDS": 1,
    },
    "ultrasound": {
        "suites.ultrasound.ultrasound.SHOTS": 3,
        "suites.ultrasound.ultrasound.INNER_TILTS_DEG": (0.0,),
    },
    "skull_suite": {
        "suites.ultrasound.skull_suite.NAMES": ("2.25MHz",),
        "suites.ultrasound.skull_suite.EXCITATIONS": ("pulse",),
        "suites.ultrasound.skull_suite.PLATE_SNRS_DB": (30.0,),
        "suites.ultrasound.skull_suite.SKULL_MM": {"2.25MHz": (5.0,)},
        "suites.ultrasound.skull_suite.PLATE_SCANS": 20,
        "suites.ultrasound.skull_suite.HARD_MM": (5.0,),
        "suites.ultrasound.skull_suite.HARD_SIDE": 5,
        "suites.ultrasound.skull_suite.PATIENTS": (0,),
        "suites.ultrasound.skull_suite.REGION_MM": 6.0,
    },
    "bone_kinds": {
        "suites.ultrasound.bone_kinds.SEEDS": (42_000,),
        "suites.ultrasound.bone_kinds.scanned": partial(
            scanned, among=UP_TO_SCAN, before=(REGION,)
        ),
        "suites.ultrasound.bone_kinds.WORLDS": (("hard", 1.0, 1),),
    },
    "recorded_rf": {
        "suites.ultrasound.recorded_rf.SEEDS": (21,),
        "suites.ultrasound.recorded_rf.CASES": {
            name: CASES[name] for name in ("plate over a floor",)
        },
        "suites.ultrasound.recorded_rf.LABORATORY_SEEDS": (500,),
        "suites.ultrasound.recorded_windows.WINDOWS": 2,
        "suites.ultrasound.recorded_rf.FAMILIES": dict(list(FAMILIES.items())[:1]),
    },
    "sound_speed": {**ONCE, "suites.ultrasound.sound_speed.PATIENTS": 5},
    "thickness": {
        "suites.ultrasound.thickness.SEEDS": (3,),
        "suites.ultrasound.thickness.PROFILE": "nominal",
        "suites.ultrasound.thickness.ONE_PASS": ONE_PASS,
        "suites.ultrasound.thickness.new_workbench": small_workbench,
    },
    "rank_ceiling": {
        "suites.ultrasound.rank_ceiling.SEEDS": (10_003, 10_007),
        "suites.honesty.thickness.RADIUS_MM": 12.0,
    },
    "start": {
        "suites.procedure.start.HELP": (("--version",),),
        "suites.procedure.start.DEMO": ("inspect", str(DEMO)),
        "suites.procedure.start.STARTS": 1,
        "suites.procedure.start.PAGES": 1,
        "suites.procedure.start.STAY_S": 0.5,
        "suites.procedure.start.QUIET_S": 0.1,
    },
    "viewer": {
        "suites.procedure.viewer.VISITS": 2,
        "suites.procedure.viewer.WARM_UP": 1,
        "suites.procedure.viewer.SETTLE_S": 0.5,
        "suites.procedure.viewer.IDLE_S": 0.5,
    },
    "saving": {
        "suites.reliability.saving.KILLS": 1,
        "suites.reliability.saving.ROWS": 2,
        "suites.reliability.saving.CUT_STEP": 997,
        "suites.reliability.saving.FLIPS": 20,
        "suites.reliability.saving.ROUNDS": 2,
        "suites.reliability.saving.FREEZES": 1,
    },
    "kills": {
        "suites.reliability.kills.KILLS": 1,
        "suites.reliability.kills.ENDS": 1,
        "suites.reliability.kills.BUSY": (True,),
        "suites.reliability.kills.KILLED": ("worker and resource tracker",),
    },
    "stop": {
        "suites.reliability.stop.STOPS": 5,
        "suites.reliability.stop.CLIENTS": 1,
    },
    "connections": {
        "suites.reliability.connections.CONNECTIONS": 6,
        "suites.reliability.connections.KINDS": {"nothing": ("", b"", 10.0)},
    },
    "readers": {"suites.reliability.readers.INPUTS": 60, "suites.reliability.readers.APART": ()},
    "procedure": {
        "suites.procedure.procedure.SEEDS": (0,),
        "suites.procedure.procedure.run_demo": short_procedure,
        "suites.procedure.procedure.SKULLS": (),
        "timed_procedure.STAGES": (),  # they are timed in the smallest case of speed
    },
    "mounting": {
        "suites.procedure.mounting.SEEDS": (30_000,),
        "suites.procedure.mounting.ONE_PASS": ONE_PASS,
        "suites.procedure.mounting.new_workbench": small_workbench,
    },
    "head_motion": {
        "suites.procedure.head_motion.SEEDS": (30_000,),
        "suites.procedure.head_motion.WORLDS": {"nominal": SetWorld(profile="nominal")},
        "suites.procedure.head_motion.ONE_PASS": ONE_PASS,
        "suites.procedure.head_motion.new_workbench": small_workbench,
    },
    "volume": {**ONCE, "suites.ultrasound.volume.SEEDS": ()},
    "placement": {
        **ONCE,
        "suites.implant.placement.ROUND_SEEDS": (38_000,),
        "suites.implant.placement.OBLONG_SEEDS": (),
        "suites.implant.placement.SEEDS": range(61_200, 61_204),
        "suites.implant.placement.REGION_MM": 22.0,
        "suites.implant.placement.SMALL_MM": 34.0,
    },
    "map_ranks": {
        "suites.accuracy.map_ranks.SEEDS": (),
        "suites.accuracy.map_ranks.SKULL_SEEDS": (),
        "suites.accuracy.map_ranks.OTHER_SEEDS": (),
        "suites.accuracy.map_ranks.FILES": (DEMO,),
    },
    "beds": {
        "suites.implant.beds.SEEDS": (),
        "suites.implant.beds.SKULL_SEEDS": (),
        "suites.implant.beds.FILES": (DEMO,),
        "suites.implant.beds.BEDS": 2,
        "suites.implant.patient_beds.SEARCHED": ("Osia/Baha screw",),
    },
    "rehearsal": {
        "suites.implant.rehearsal.SEEDS": (),
        "suites.implant.rehearsal.FILES": (DEMO,),
        "suites.implant.rehearsal.DEEP_BEDS": 0,
    },
    "force_guard": {
        "suites.implant.force_guard.SEEDS": (),
        "suites.implant.force_guard.FILES": (DEMO,),
        "suites.implant.force_guard.BEDS": {"Osia/Baha screw": 1},
    },
    "bed_lines": {
        "suites.implant.bed_lines.SEEDS": (),
        "suites.implant.bed_lines.FILES": (DEMO,),
        "suites.implant.bed_lines.KINDS": ("best lines",),
        "suites.implant.bed_lines.DRAWS": 60,
    },
    "probe_choice": {"suites.accuracy.probe_choice.SEEDS": ()},
    "passes": {
        "suites.accuracy.passes.SEEDS": (),
        "suites.accuracy.passes.FILES": (DEMO,),
    },
    "pass_faults": {
        "suites.accuracy.pass_faults.SEEDS": (),
        "suites.accuracy.pass_faults.FILES": (DEMO,),
        "suites.accuracy.pass_faults.FAULTS": {"no fault": None},
    },
    "accuracy": {
        **ONCE,
        "suites.accuracy.accuracy.SEEDS": (),
        "suites.accuracy.accuracy.NOMINAL_SEEDS": (),
        "suites.accuracy.accuracy.SKULL_SEEDS": (),
        "suites.accuracy.accuracy.PLACES": {},
        "suites.accuracy.accuracy.FILES": (DEMO,),
        "suites.accuracy.judged_maps.DRAWS": 10,
        "suites.accuracy.map_cost.PITCH_MM": 10.0,
        "suites.accuracy.map_cost.DRAWS": 2,
    },
    "implant": {
        **ONCE,
        "suites.implant.milled_beds.IMPLANTS": ("BCI 602",),
        "suites.implant.milled_beds.LIFTS_MM": (4.0,),
        "suites.implant.milled_beds.RIDGES": ((5.0, 0.5),),
        "suites.implant.milled_beds.RINGS": 2,
        "suites.implant.milled_beds.REMOVALS": 1,
        "suites.implant.milled_beds.VOLUME_CELL_MM": 0.4,
        "suites.implant.pole.DEPTH_MM": 1.0,
        "suites.implant.pole.CELL_MM": 0.2,
    },
    "honesty": {
        "suites.honesty.navigation.SEEDS": range(33_000, 33_002),
        "suites.honesty.latency.SEEDS": (),
        "suites.honesty.maps.SEEDS": (),
        "suites.honesty.thickness.SEEDS": (10_003,),
        "suites.honesty.thickness.RADIUS_MM": 12.0,
    },
    "speed": {
        **ONCE,
        "suites.procedure.speed.SEEDS": (0,),
        "suites.procedure.speed.FRAMES": 512,
        "timed_procedure.STAGES": SHORT,
        "timed_procedure.new_workbench": small_workbench,
        "reference.yardstick.SMALL_ROUNDS": 20,
        "reference.yardstick.MEDIUM_ROUNDS": 1,
        "cases.growth.ROUNDS": 1,
        "cases.growth.FRAMES": 256,
    },
}


@contextmanager
def set_to(values: Mapping[str, Any]) -> Generator[None]:
    """Give constants of the benchmarks other values for a while; names are ``module.CONSTANT``."""
    with ExitStack() as stack:
        for place, value in values.items():
            module_name, _, name = place.rpartition(".")
            module = importlib.import_module(f"benchmarks.{module_name}")
            stack.callback(setattr, module, name, getattr(module, name))
            setattr(module, name, value)
        yield
