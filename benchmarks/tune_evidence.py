"""``python -m benchmarks.tune_evidence``: fit the weights of the evidence to the tuning scenes.

A multinomial logistic regression: of the candidates of an A-scan one is the inner boundary, or
none is. Run once for the log odds of single A-scans, then for those with their neighbours.
The scenes have materials, texture, pulses and shapes drawn at random, other ones than the test.
"""

import sys
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.detect import nominal_bone
from rona_core.ultrasound.detection.single.candidates import clear_fronts, search_echoes
from rona_core.ultrasound.detection.single.inner_echo import Candidates, inner_grid_mm
from rona_core.ultrasound.detection.spatial.candidate_selection import features, joint_features
from rona_core.ultrasound.detection.spatial.neighbours import Links, scan_links
from rona_core.ultrasound.detection.spatial.track_before_detect import Tracks, along_tracks
from rona_core.ultrasound.probe.probe_model import ProbeSurvey
from tests.scenes.bone_record import BoneScene
from tests.scenes.bone_scenes import TRIAL_SEEDS, anatomical_bone, hard_bone, parallel_bone

RIGHT_MM = {"1MHz": 0.8, "2.25MHz": 0.6}  # a candidate this close is the inner echo
ENDLESS_SHARE = 1.0  # what a scene without inner boundary counts for
ENDLESS_MM, ENDLESS_SNR_DB = 90.0, (50.0, 40.0, 55.0)
PENALTY = 1e-3  # on the square of a weight
UP, DOWN = (0.0, None), (None, 0.0)  # what a feature may speak for
SIGNS = ((None, None), UP, DOWN, UP, DOWN, DOWN, UP, DOWN, DOWN, DOWN, UP, UP, UP)
SKULL_MM = {"2.25MHz": (3.0, 4.0, 5.0, 7.0, 8.5, 10.0), "1MHz": (4.5, 6.0, 8.0, 10.0)}
HARD_MM, HARD_SIDE, PATIENTS = (5.0, 7.0), 12, (0, 1, 2)


def tuning_scenes(name: str, excitation: Excitation, seed: int) -> list[BoneScene]:
    """Return the scenes of one seed that the detection may be tuned with."""
    scenes: list[BoneScene] = []
    for mm in SKULL_MM[name]:
        scenes += parallel_bone(
            mm, name=name, excitation=excitation, patches=1, nominal=False, drawn_seed=seed
        )
    for mm in HARD_MM:
        scenes.append(
            hard_bone(
                mm,
                name=name,
                excitation=excitation,
                side=HARD_SIDE,
                nominal=False,
                drawn_seed=seed,
            )
        )
    for patient in PATIENTS:
        scenes.append(
            anatomical_bone(
                patient, name=name, excitation=excitation, nominal=False, drawn_seed=seed
            )
        )
    return scenes


def endless_bone(number: int, name: str, excitation: Excitation) -> BoneScene:
    """Return a patch of bone so thick that it has no inner boundary for the probe."""
    snr = ENDLESS_SNR_DB[number]
    scene = parallel_bone(
        ENDLESS_MM, name=name, excitation=excitation, front_snr_db=snr, side=10, patches=1
    )[0]
    return replace(scene, name=f"endless {number}")


def fit(values: Floats, exists: Bools, right: Ints, shares: Floats) -> Floats:
    """Return the weights (f,) for features (n, k, f); ``right`` (n,) is k where none is right."""
    n = len(right)
    target = np.zeros((n, values.shape[1] + 1))
    target[np.arange(n), right] = 1.0
    shares = shares / shares.sum()

    def loss(weights: Floats) -> tuple[float, Floats]:
        odds = np.column_stack((np.where(exists, values @ weights, -1e9), np.zeros(n)))
        odds -= odds.max(axis=1, keepdims=True)
        chance = np.exp(odds) / np.exp(odds).sum(axis=1, keepdims=True)
        likely = np.log(np.maximum((chance * target).sum(axis=1), 1e-12))
        slope = np.where(exists[..., None], values, 0.0)
        gradient = np.einsum("n,nk,nkf->f", shares, (chance - target)[:, :-1], slope)
        free = np.append(0.0, weights[1:])
        return float(-shares @ likely + PENALTY * free @ free), gradient + 2 * PENALTY * free

    bounds = SIGNS[: values.shape[2]]
    found = minimize(loss, np.zeros(values.shape[2]), jac=True, method="L-BFGS-B", bounds=bounds)
    return np.asarray(found.x, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A scene as the regression needs it."""

    candidates: Candidates
    own: Floats  # features (n, k, f)
    depth_mm: Floats  # (n, k)
    tracks: Tracks
    links: Links
    right: Ints  # (n,)
    shares: Floats  # (n,)


def cases(name: str) -> list[Case]:
    """Return all tuning scenes of a probe."""
    found: list[Case] = []
    for excitation in ("pulse", "chirp"):
        scenes = [s for seed in TRIAL_SEEDS for s in tuning_scenes(name, excitation, seed)]
        scenes += [endless_bone(k, name, excitation) for k in range(len(ENDLESS_SNR_DB))]
        found += [case_of(scene) for scene in scenes]
    return found


def case_of(scene: BoneScene) -> Case:
    """Return what the regression needs of a scene."""
    bone = nominal_bone()
    survey = ProbeSurvey(scene.track, scene.probe, scene.settings.excitation)
    echoes = search_echoes(clear_fronts(survey), bone)
    c = echoes.candidates
    depth = c.lag_us * bone.speed_mm_per_us / 2.0
    off = np.abs(c.lag_us - scene.bone_us[:, None]) * bone.speed_mm_per_us / 2.0
    off = np.where(c.exists, off, np.inf)
    near = off.min(axis=1) < RIGHT_MM[scene.settings.name]
    right = np.where(near, off.argmin(axis=1), off.shape[1])
    share = ENDLESS_SHARE if scene.name.startswith("endless") else 1.0
    shares = np.full(len(scene), share * len(scene) ** -0.5)
    links = scan_links(scene.points_skull, len(scene))
    grid = inner_grid_mm(scene.probe, bone)
    tracks = along_tracks(echoes.log_likelihood, echoes.snr, grid, depth, links)
    return Case(c, features(c), depth, tracks, links, right, shares)


def main() -> None:
    """Print both sets of weights for both probes."""
    for name in ("1MHz", "2.25MHz"):
        all_cases = cases(name)
        exists = np.concatenate([case.candidates.exists for case in all_cases])
        right = np.concatenate([case.right for case in all_cases])
        shares = np.concatenate([case.shares for case in all_cases])
        own = np.concatenate([case.own for case in all_cases])
        alone = fit(own, exists, right, shares)
        joint = [
            joint_features(x.own, x.own @ alone, x.depth_mm, x.candidates, x.tracks, x.links)
            for x in all_cases
        ]
        together = fit(np.concatenate(joint), exists, right, shares)
        for label, weights in (("ALONE", alone), ("TOGETHER", together)):
            sys.stdout.write(f"{label} {name}: {', '.join(f'{w:.2f}' for w in weights)}\n")


if __name__ == "__main__":
    main()
