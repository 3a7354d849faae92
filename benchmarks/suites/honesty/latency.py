"""Latency of the joint angles against the set one: procedures up to the first maps."""

import numpy as np

from benchmarks.suites.honesty.design import session_of
from benchmarks.suites.honesty.judged import Judged
from rona_core.app.procedure import stages
from rona_core.app.steps.scan.derivation import DELAY

SEEDS = range(40_200, 40_260)
FIRST_MAPS = stages("detection")


def judge(seed: int) -> list[Judged]:
    """Return the error of the latency and its predicted sigma.

    Raises:
        RonaError: the procedure did not come as far as the maps.
    """
    session = session_of(seed, among=FIRST_MAPS)
    found = DELAY.read(session)
    if found is None:
        return []
    off_s = found.delay_s - session.setup.devices.robot.latency_ms / 1000.0
    errors, sigmas = np.array([1000.0 * off_s]), np.array([1000.0 * found.sigma_s])
    return [Judged("latency of the joint angles (ms)", "common", seed, errors, sigmas)]
