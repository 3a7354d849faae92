"""The smallest case of every suite: seconds, to see that it runs; its figures tell nothing."""

import importlib
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchmarks.laboratory_families import FAMILIES
from benchmarks.recorded_cases import CASES

DEMO = Path(__file__).resolve().parents[1] / "sessions" / "demo.rona"
ONCE = {"metric.REPEATS": 1}
# suite -> constant of a module of the benchmarks -> its value in the smallest case
SMALLEST: Mapping[str, Mapping[str, Any]] = {
    "navigation": {
        **ONCE,
        "suites.navigation.TRIALS": 2,
        "registration_cases.TRIALS": 3,
        "registration_cases.MAPS": 2,
        "registration_cases.SURFACES": 1,
        "pivot_cases.TRIALS": 4,
        "pointer_map.SEEDS": (),
    },
    "base_marker": {"suites.base_marker.TRIALS": 3},
    "path": {
        **ONCE,
        "suites.path.SEEDS": range(1),
        "suites.path.FAST_SEEDS": range(1),
        "suites.path.LONG_POINTS": 6000,
        "suites.path.GREEDY_TRIALS": 1,
        "suites.path.BRUTE_TRIALS": 1,
        "normal_cases.SEEDS": (),
        "normal_cases.PATHS": 1,
    },
    "robot": {
        **ONCE,
        "suites.robot.RESIDUAL_POSES": 400,
        "suites.robot.POSES": 400,
        "suites.robot.FORWARD_POSES": 200,
        "suites.robot.PEER_POSES": 200,  # Newton takes 200 of them
    },
    "roll": {
        **ONCE,
        "suites.roll.LONG_SCENES": ("S0",),
        "suites.roll.TRAVEL_RAD": {("S0", 90): 8.401},
    },
    "timing": {
        **ONCE,
        "suites.timing.FEASIBLE_SCENES": ("S0",),
        "suites.timing.SPEEDS": (50.0, 20.0),
    },
    "collision": {
        **ONCE,
        "suites.collision.CONFIGURATIONS": 50,
        "suites.collision.HEADS": 1,
    },
    "base_placement": {**ONCE, "suites.base_placement.SCENES": ("S0",)},
    "contact": {
        **ONCE,
        "suites.contact.STIFFNESSES": (2.0,),
        "suites.contact.TRIALS": 2,
    },
    "echo_model": {
        **ONCE,
        "suites.echo_model.STRIPS": ("1mhz_flat",),
        "suites.echo_model.FINER": "none",
        "suites.echo_model.LEANS_DEG": (3.0,),
        "suites.echo_model.BONES": 1,
        "suites.echo_model.ROUNDS": 1,
    },
    "ultrasound": {"suites.ultrasound.SHOTS": 3, "suites.ultrasound.INNER_TILTS_DEG": (0.0,)},
    "skull_suite": {
        "suites.skull_suite.NAMES": ("2.25MHz",),
        "suites.skull_suite.EXCITATIONS": ("pulse",),
        "suites.skull_suite.PLATE_SNRS_DB": (30.0,),
        "suites.skull_suite.SKULL_MM": {"2.25MHz": (5.0,)},
        "suites.skull_suite.PLATE_SCANS": 20,
        "suites.skull_suite.HARD_MM": (5.0,),
        "suites.skull_suite.HARD_SIDE": 5,
        "suites.skull_suite.PATIENTS": (0,),
        "suites.skull_suite.REGION_MM": 6.0,
    },
    "bone_kinds": {
        "suites.bone_kinds.SEEDS": (41_000,),
        "suites.bone_kinds.WORLDS": (("hard", 1.0, 1),),
    },
    "recorded_rf": {
        "suites.recorded_rf.SEEDS": (21,),
        "suites.recorded_rf.CASES": {name: CASES[name] for name in ("plate over a floor",)},
        "suites.recorded_rf.LABORATORY_SEEDS": (500,),
        "suites.recorded_rf.FAMILIES": dict(list(FAMILIES.items())[:1]),
    },
    "sound_speed": {**ONCE, "suites.sound_speed.PATIENTS": 5},
    "thickness": {"suites.thickness.SEEDS": (0,), "suites.thickness.POINTS": ()},
    "viewer": {
        "suites.viewer.VISITS": 2,
        "suites.viewer.WARM_UP": 1,
        "suites.viewer.SETTLE_S": 0.5,
        "suites.viewer.IDLE_S": 0.5,
    },
    "kills": {"suites.kills.KILLS": 1, "suites.kills.ENDS": 1},
    "procedure": {"suites.procedure.SEEDS": (0,), "suites.procedure.SKULLS": ()},
    "map_bands": {"suites.map_bands.SEEDS": (), "suites.map_bands.FILES": (DEMO,)},
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
