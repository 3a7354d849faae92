"""Maps and A-scans against the truth: whole procedures in the realistic world."""

from collections.abc import Iterator

import numpy as np

from benchmarks.reference.map_coverage import bands
from benchmarks.suites.honesty.design import session_of
from benchmarks.suites.honesty.judged import Judged
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.scan_metrics import WRONG_MM, true_probe_poses
from rona_core.evaluation.truth import truth_of
from rona_core.session.document import Session
from rona_core.virtual.acoustics.medium import bone_medium, true_bone

SEEDS = range(41_300, 41_408)
CELLS = 400  # of a map that are looked at


def judge(seed: int) -> list[Judged]:
    """Return errors and predicted sigmas of one session.

    Raises:
        RonaError: the procedure did not come to its end.
    """
    session = session_of(seed)
    return [*maps(session, seed), *ascans(session, seed)]


def maps(session: Session, seed: int) -> Iterator[Judged]:
    """Yield what all cells of a map share, and what each has for itself."""
    for name, band in bands(session):
        title = f"{name.replace('_', ' ')} (mm)"
        mean = band.errors_mm.mean()
        if band.shared_mm > 0.0:
            shared = np.array([band.shared_mm])
            yield Judged(title, "common", seed, np.array([mean]), shared)
        some = np.unique(np.linspace(0, len(band.errors_mm) - 1, CELLS).astype(np.int64))
        errors, sigmas = band.errors_mm[some] - mean, band.own_mm[some]
        yield Judged(title, "local", seed, errors, sigmas, varies=True)


def ascans(session: Session, seed: int) -> Iterator[Judged]:
    """Yield the thickness of sure A-scans at the true speed of sound: their time of flight.

    Those that took another echo (1 mm off) are counted as failures elsewhere.
    """
    scan, found = session.captures.scan, session.results.detection
    if scan is None or found is None:
        return
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    poses = true_probe_poses(scan, truth)
    speed, depth = true_bone(poses, truth.scene, bone_medium(truth.scene.world))
    value = found.value
    factor = speed / value.sound_speed_mm_per_us
    off = value.thickness_mm * factor - depth
    sure = np.asarray(value.inner_ok) & np.isfinite(off)
    sure[sure] = np.abs(off[sure]) < WRONG_MM
    sigmas = value.thickness_sigma_mm[sure] * factor[sure]
    yield Judged("time of flight of A-scans (mm)", "local", seed, off[sure], sigmas, varies=True)
