"""What suites leave out by default, so that each takes at most five minutes of one core.

The constants in the suites are those of the whole, which ``--full`` runs. By default there are
fewer seeds, and all the figures with their goals. Of a suite that is not named here all runs.
"""

from collections.abc import Mapping
from typing import Any

# suite -> constant of a module of the benchmarks -> its value by default
DEFAULT: Mapping[str, Mapping[str, Any]] = {
    "procedure": {"suites.procedure.procedure.SEEDS": range(5)},
    "honesty": {
        "suites.honesty.latency.SEEDS": range(40_200, 40_212),
        "suites.honesty.maps.SEEDS": range(40_420, 40_432),
        "suites.honesty.navigation.SEEDS": range(33_000, 33_024),
        "suites.honesty.thickness.SEEDS": range(47_000, 47_024),
    },
    "accuracy": {
        "suites.accuracy.accuracy.SEEDS": range(37_800, 37_803),
        "suites.accuracy.accuracy.NOMINAL_SEEDS": range(37_100, 37_102),
        "suites.accuracy.accuracy.SKULL_SEEDS": range(37_840, 37_841),
        "suites.accuracy.accuracy.PLACES": {},
    },
    "passes": {"suites.accuracy.passes.SEEDS": range(64_100, 64_112)},
    "probe_choice": {"suites.accuracy.probe_choice.SEEDS": (61_201, 61_204)},
    "map_ranks": {
        "suites.accuracy.map_ranks.SEEDS": range(21_000, 21_006),
        "suites.accuracy.map_ranks.SKULL_SEEDS": (),
        "suites.accuracy.map_ranks.OTHER_SEEDS": range(40_540, 40_546),
    },
    "placement": {
        "suites.implant.placement.ROUND_SEEDS": range(38_000, 38_003),
        "suites.implant.placement.OBLONG_SEEDS": (),
        "suites.implant.placement.SEEDS": range(61_200, 61_400),
    },
    "beds": {
        "suites.implant.beds.SEEDS": range(41_084, 41_090),
        "suites.implant.beds.SKULL_SEEDS": range(38_059, 38_060),
    },
    "rehearsal": {"suites.implant.rehearsal.SEEDS": range(39_000, 39_002)},
    "force_guard": {"suites.implant.force_guard.SEEDS": range(41_100, 41_104)},
    "bed_lines": {"suites.implant.bed_lines.SEEDS": range(42_080, 42_082)},
    "thickness": {"suites.ultrasound.thickness.SEEDS": range(31_000, 31_008)},
    "rank_ceiling": {"suites.ultrasound.rank_ceiling.SEEDS": range(45_000, 45_016)},
    "speed": {"suites.procedure.speed.SEEDS": range(3)},
    "saving": {"suites.reliability.saving.KILLS": 25},
    "head_motion": {"suites.procedure.head_motion.SEEDS": range(34_000, 34_004)},
}
