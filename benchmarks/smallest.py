"""The smallest case of every suite: seconds, to see that it runs; its figures tell nothing."""

import importlib
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.scenes.laboratory.families import FAMILIES
from tests.scenes.tank_recordings import CASES

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"
ONCE = {"metric.REPEATS": 1}
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
    "path": {
        **ONCE,
        "suites.navigation.path.SEEDS": range(1),
        "suites.navigation.path.FAST_SEEDS": range(1),
        "suites.navigation.path.LONG_POINTS": 6000,
        "suites.navigation.path.GREEDY_TRIALS": 1,
        "suites.navigation.path.BRUTE_TRIALS": 1,
        "cases.surface_normals.SEEDS": (),
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
        "suites.ultrasound.bone_kinds.SEEDS": (41_000,),
        "suites.ultrasound.bone_kinds.WORLDS": (("hard", 1.0, 1),),
    },
    "recorded_rf": {
        "suites.ultrasound.recorded_rf.SEEDS": (21,),
        "suites.ultrasound.recorded_rf.CASES": {
            name: CASES[name] for name in ("plate over a floor",)
        },
        "suites.ultrasound.recorded_rf.LABORATORY_SEEDS": (500,),
        "suites.ultrasound.recorded_rf.FAMILIES": dict(list(FAMILIES.items())[:1]),
    },
    "sound_speed": {**ONCE, "suites.ultrasound.sound_speed.PATIENTS": 5},
    "thickness": {
        "suites.ultrasound.thickness.SEEDS": (0,),
        "suites.ultrasound.thickness.POINTS": (),
    },
    "viewer": {
        "suites.procedure.viewer.VISITS": 2,
        "suites.procedure.viewer.WARM_UP": 1,
        "suites.procedure.viewer.SETTLE_S": 0.5,
        "suites.procedure.viewer.IDLE_S": 0.5,
    },
    "kills": {"suites.procedure.kills.KILLS": 1, "suites.procedure.kills.ENDS": 1},
    "procedure": {
        "suites.procedure.procedure.SEEDS": (0,),
        "suites.procedure.procedure.SKULLS": (),
    },
    "map_bands": {
        "suites.procedure.map_bands.SEEDS": (),
        "suites.procedure.map_bands.FILES": (DEMO,),
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
