"""The pointer held in the landmarks around the head, one after the other."""

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.virtual.operator.hand_trajectories import (
    SHAFT_TREMOR_RAD,
    pivot_axis,
    tangent_axes,
    tilted,
)
from rona_core.virtual.pointer_motion import (
    TREMOR_HZ,
    BandLimitedNoise,
    TipTrajectory,
    sample_times_s,
)
from rona_core.virtual.scene import VirtualScene

SEAT_SD_MM = 0.04  # per axis: how the tip sits in a divot
LIFTED_MM = 40.0  # between two of them
TIMES_S = (0.1, 60.0)


def touch_landmarks(
    scene: VirtualScene,
    names: tuple[str, ...],
    dwell_s: float,
    travel_s: float,
    generator: np.random.Generator,
) -> TipTrajectory:
    """Return a motion that rests for ``dwell_s`` in each landmark, ``travel_s`` after the last.

    Raises:
        InvalidInputError: no landmark of that name, or a time out of range.
    """
    for time_s in (dwell_s, travel_s):
        if not TIMES_S[0] <= time_s <= TIMES_S[1]:
            raise InvalidInputError(f"dwell_s and travel_s must be 0.1 to 60, not {time_s}")
    unknown = [name for name in names if name not in scene.landmarks_base]
    if unknown or not names:
        raise InvalidInputError(
            f"landmarks must be among {', '.join(scene.landmarks_base)}, not {unknown}"
        )
    places = np.array([scene.landmarks_base[name] for name in names])
    places = places + generator.normal(0.0, SEAT_SD_MM, places.shape)
    times, tips = resting(places, dwell_s, travel_s)
    tremor = BandLimitedNoise.draw(generator, TREMOR_HZ, SHAFT_TREMOR_RAD, 2).at(times)
    sight = scene.T_base_tracker.translation - places.mean(axis=0)
    sight = sight / np.linalg.norm(sight)
    x, y, z = tangent_axes(pivot_axis(sight), sight)
    return TipTrajectory(times, tips, tilted(np.broadcast_to(z, tips.shape), x, y, tremor))


def resting(places: Floats, dwell_s: float, travel_s: float) -> tuple[Floats, Floats]:
    """Return times (m,) and tips (m, 3) of a hand that rests in places (n, 3), lifted between.

    It begins above the first one. Between two it moves with least jerk (Flash 1985).
    """
    each_s = travel_s + dwell_s
    times = sample_times_s(each_s * len(places))
    number = np.minimum((times / each_s).astype(np.int64), len(places) - 1)
    share = np.clip((times - each_s * number) / travel_s, 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    above = places[:1] + (0.0, 0.0, LIFTED_MM)
    starts = np.vstack((above, places[:-1]))[number]
    tips = starts + share[:, None] * (places[number] - starts)
    tips[:, 2] += np.where(number > 0, 4.0 * LIFTED_MM * share * (1.0 - share), 0.0)
    return times, tips
