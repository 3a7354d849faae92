"""Selection of the inner echo among the candidates of each A-scan, and its time of flight.

The candidates of each A-scan are judged by their own features and by those of the A-scans around
it (``candidate_features.py``, ``semi_global_matching.py``), and the one selected is timed
(``time_of_flight.py``). The runner-up is kept with its probability.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.single.candidates import BLOCK, Echoes
from rona_core.ultrasound.detection.single.inner_echo import InnerEchoes, inner_grid_mm
from rona_core.ultrasound.detection.single.thin_bone import thick_enough
from rona_core.ultrasound.detection.single.time_of_flight import (
    EnvelopePeaks,
    InnerFits,
    choose_cycles,
    fit_inner,
)
from rona_core.ultrasound.detection.spatial.candidate_features import (
    ALONE,
    TOGETHER,
    features,
    joint_features,
    log_odds,
    neighbour_weight,
)
from rona_core.ultrasound.detection.spatial.detectability import spread_along_interface
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links
from rona_core.ultrasound.detection.spatial.neighbour_prediction import predict_lags
from rona_core.ultrasound.detection.spatial.semi_global_matching import candidate_probabilities
from rona_core.ultrasound.detection.spatial.track_before_detect import along_tracks
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

SAME_MM = 0.5  # candidates this close are the same boundary
RAYLEIGH = np.log(2.0)  # median over mean of the power of noise
DOUBT = 1.25, 3.0  # a boundary behind makes no choice surer than this line
LIKELY = 0.5  # chance from which on an inner echo is a witness for those beside it
CYCLE_ROUNDS = 6  # of asking neighbours which cycle is meant
EXPECTED_SD_MM = 0.2  # of thickness about the plane through those around
MOVED_CYCLES = 1.0  # by which those around may move a time; further off, they show another
MOVED = 0.5  # boundary, and it is as likely as not that this is the right one
OBLIQUE = (
    0.016  # sigma over rise times squared width of the aperture, 1 / mm; the rise in us per mm
)
STEEPEST = 1.0  # is no larger than this over the speed: a boundary oblique by 27 degrees
SPARE_NOISE = 1.5  # what part of the noise's power counts as clutter by chance


def select_inner_echoes(echoes: Echoes, bone: Material, links: Links) -> InnerEchoes:
    """Return the inner echo of each A-scan of a survey.

    Args:
        echoes: Fronts and candidates.
        bone: Nominal bone.
        links: Who is beside whom.
    """
    found, template = echoes.candidates, echoes.template
    depth = found.lag_us * bone.speed_mm_per_us / 2.0
    probability, behind = inner_probabilities(echoes, depth, bone, links)
    rows, best = np.arange(len(depth)), np.argmax(probability[:, :-1], axis=1)
    same: Bools = np.abs(depth - depth[rows, best][:, None]) < SAME_MM
    confidence = np.sum(probability[:, :-1] * same, axis=1)
    others = np.where(same, 0.0, probability[:, :-1])
    second = np.argmax(others, axis=1)
    fits = _fitted(echoes, best, bone)
    lag, sigma = _timed(fits, confidence, bone, template.probe, links)
    behind = spread_along_interface(behind, depth, found, links, template.probe)
    doubted = np.clip(DOUBT[0] - DOUBT[1] * behind[rows, best], 0.0, 1.0)
    thick = thick_enough(echoes.merged, found.level[rows, best])
    moved = np.abs(lag - fits.envelope_us) > MOVED_CYCLES * fits.period_us
    return InnerEchoes(
        lag_us=lag,
        confidence=np.where(moved, MOVED, 1.0) * np.minimum(np.minimum(confidence, doubted), thick),
        detected=np.asarray(probability[:, -1] < 0.5),
        sigma_us=sigma,
        alternative_us=found.lag_us[rows, second],
        alternative_confidence=others[rows, second],
    )


def inner_probabilities(
    echoes: Echoes, depth_mm: Floats, bone: Material, links: Links
) -> tuple[Floats, Floats]:
    """Return the probability (n, k + 1) of each candidate, and last that none is right.

    The second array (n, k) is how sure a boundary is behind each that is no multiple of it.
    """
    found, probe = echoes.candidates, echoes.template.probe
    grid = inner_grid_mm(probe, bone)
    single = features(found)
    alone = log_odds(single, ALONE, probe)
    tracks = along_tracks(echoes.log_likelihood, echoes.snr, grid, depth_mm, links)
    values = joint_features(single, alone, depth_mm, found, tracks, links)
    share = neighbour_weight(links)
    odds = share * log_odds(values, TOGETHER, probe) + (1.0 - share) * alone
    probability = candidate_probabilities(odds, depth_mm, found.exists, grid, links)
    return probability, share * tracks.behind


def _timed(
    fits: InnerFits, confidence: Floats, bone: Material, probe: ProbeModel, links: Links
) -> tuple[Floats, Floats]:
    """Return the lags (n,) and sigmas, the cycle resolved with the A-scans around."""
    lag, sigma = choose_cycles(fits)
    floor = 2.0 * EXPECTED_SD_MM / bone.speed_mm_per_us
    steep = np.zeros(len(lag))
    for _ in range(CYCLE_ROUNDS):
        expected, sd, steep = predict_lags(lag, sigma, confidence > LIKELY, links)
        lag, sigma = choose_cycles(fits, expected, np.hypot(sd, floor))
    rise = np.minimum(steep, STEEPEST / bone.speed_mm_per_us)
    return lag, np.hypot(sigma, OBLIQUE * (2.0 * probe.aperture_radius_mm) ** 2 * rise)


def _fitted(echoes: Echoes, best: Ints, bone: Material) -> InnerFits:
    """Return the chosen candidates (n,) as fitted by envelope and by phase."""
    found, rows = echoes.candidates, np.arange(len(best))
    lag, level = found.lag_us[rows, best], found.level[rows, best]
    noise, median = found.noise[rows, best], found.clutter[rows, best]
    clutter = np.sqrt(np.maximum(median**2 / RAYLEIGH - SPARE_NOISE * noise**2, 0.0))
    peaks = EnvelopePeaks(lag, level, clutter)
    fits: list[InnerFits] = []
    for start in range(0, len(best), BLOCK):
        block = slice(start, start + BLOCK)
        fits.append(
            fit_inner(
                echoes.aligned[block],
                echoes.fronts[block],
                echoes.noise[block],
                peaks[block],
                echoes.template,
                bone,
            )
        )
    return InnerFits.concatenate(fits)
