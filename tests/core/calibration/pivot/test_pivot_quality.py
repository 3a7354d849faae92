import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.pivot.quality import (
    PivotFacts,
    correlated_poses,
    judge_pivot,
    longest_run,
    predicted_by_cone,
)
from rona_core.calibration.tracking_error import EVEN, MarkerNoise
from rona_core.geometry.pose import Poses
from tests.helpers.pivots import GEOMETRY, TIPS, pose_sweep, spoiled

DEPTH = MarkerNoise()
FINE = PivotFacts(
    tip_sigma_mm=0.2, cone_deg=25.0, swing_deg=(20.0, 25.0), n=100, n_used=100, narrowness=1
)
NONE = np.zeros(0, dtype=np.int64)


def calibrate(poses, dof=6, **options):
    return calibrate_pointer(
        poses, pointer="p", dof=dof, positions_pointermarker=GEOMETRY[dof], **options
    )


def test_a_good_fit_needs_no_reasons():
    assert judge_pivot(FINE, NONE) == ("good", ())
    found = calibrate(pose_sweep(np.random.default_rng(1), 6, DEPTH, n=300, cone_deg=25.0))
    assert (found.verdict, found.reasons) == ("good", ())


@pytest.mark.parametrize(
    ("change", "rejected", "verdict", "words"),
    [
        ({"tip_sigma_mm": 0.7}, 0, "weak", "0.7 mm only, 0.5 mm are wanted: sweep to 40 degrees"),
        ({"tip_sigma_mm": 1.4}, 0, "bad", "sweep to 45 degrees and record"),
        ({"cone_deg": 8.0}, 0, "weak", "cone of 8 degrees is too narrow: sweep to 20 degrees"),
        ({"swing_deg": (5.0, 25.0)}, 0, "weak", "one plane (25 degrees one way, 5 across)"),
        ({"n_used": 12}, 0, "weak", "only 12 poses count"),
        ({}, 15, "weak", "15 of 100 poses are rejected"),
        ({}, 28, "bad", "28 of 100 poses are rejected"),
        ({"marker_sigma_mm": 1.5}, 0, "weak", "as if a marker erred by 1.5 mm"),
        ({"marker_sigma_mm": 3.0}, 0, "bad", "check the marker geometry"),
        ({"marker_sigma_mm": 0.8}, 0, "good", ""),
        ({"tip_sigma_mm": 0.6, "alike": 9.0}, 0, "weak", "about 9 neighbouring poses"),
        ({"alike": 9.0}, 0, "good", ""),
    ],
)
def test_each_shortcoming_has_its_verdict_and_its_words(change, rejected, verdict, words):
    rows = np.random.default_rng(0).permutation(np.arange(0, 99, 3))[:rejected]
    found, reasons = judge_pivot(replace(FINE, **change), np.sort(rows))
    assert found == verdict
    assert words in " | ".join(reasons)
    assert bool(reasons) == (verdict != "good")


def asked_for(reasons):
    return float(re.search(r"sweep to (\d+) degrees", " ".join(reasons))[1])


@given(cone=st.floats(6.0, 40.0), sigma=st.floats(0.51, 3.0), narrowness=st.sampled_from([1, 2]))
def test_the_cone_that_is_asked_for_would_be_enough_and_no_narrower_one(cone, sigma, narrowness):
    facts = replace(FINE, cone_deg=cone, tip_sigma_mm=sigma, narrowness=narrowness)
    _, reasons = judge_pivot(facts, NONE)
    known = dict(predicted_by_cone(facts))
    chosen = asked_for(reasons[:1])
    if "record" not in reasons[0]:
        assert known[chosen] <= 0.5
        assert all(known[narrower] > 0.5 for narrower in known if cone < narrower < chosen)
    else:
        assert known[45.0] > 0.5


@pytest.mark.parametrize(("dof", "noise"), [(6, DEPTH), (6, EVEN), (5, DEPTH)])
def test_the_cone_that_is_asked_for_is_enough_when_it_is_swept(dof, noise):
    def sigma(cone_deg):
        sweeps = (
            pose_sweep(np.random.default_rng(seed), dof, noise, n=25, cone_deg=cone_deg)
            for seed in range(5)
        )
        found = [calibrate(poses, dof, noise=noise) for poses in sweeps]
        worst = max(found, key=lambda f: f.tip_sigma_mm)
        return float(np.median([f.tip_sigma_mm for f in found])), worst.reasons

    narrow, reasons = sigma(9.0)
    assert narrow > 0.5
    needed = asked_for(reasons)
    assert sigma(needed)[0] < 0.55
    assert sigma(needed - 10.0)[0] > 0.42  # the sine law asks for one step too much at most


def test_a_narrow_cone_and_a_slip_are_told_from_the_poses():
    narrow = calibrate(pose_sweep(np.random.default_rng(3), 6, DEPTH, cone_deg=8.0))
    assert narrow.verdict != "good"
    assert "too narrow: sweep to 20 degrees" in " | ".join(narrow.reasons)
    rng = np.random.default_rng(3)
    poses = pose_sweep(rng, 6, DEPTH)
    slipped = calibrate(spoiled(rng, poses, "slipped for a while"))
    assert "nearly all from 0 to 19: the tip slipped" in " | ".join(slipped.reasons)
    shift = np.zeros((100, 3))
    shift[np.random.default_rng(0).choice(100, 15, replace=False)] = (0.0, 9.0, 0.0)
    scattered = calibrate(Poses(poses.rotations, poses.translations + shift))
    assert "15 of 100 poses are rejected: look for" in " | ".join(scattered.reasons)


def test_a_swing_mostly_in_one_plane_is_told():
    rng = np.random.default_rng(3)
    wide = pose_sweep(rng, 6, DEPTH, n=600, cone_deg=30.0)
    sideways = np.abs((wide.rotations @ (0.0, 1.0, 0.0))[:, 0]) < 0.08
    found = calibrate(wide.select(sideways))
    assert found.verdict == "weak"
    assert "nearly in one plane" in " | ".join(found.reasons)


def test_methods_of_others_are_judged_too():
    poses = pose_sweep(np.random.default_rng(3), 6, DEPTH, cone_deg=9.0)
    found = calibrate(poses, method="sphere")
    assert found.verdict == "bad"
    assert found.marker_sigma_mm is None
    trace = np.trace(found.tip_covariance_pointermarker)
    assert found.tip_sigma_mm == pytest.approx(np.sqrt(trace))


def test_a_slow_error_counts_as_fewer_poses():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(4000, 3))
    slow = np.zeros((4000, 3))
    for i in range(1, 4000):
        slow[i] = 0.9 * slow[i - 1] + white[i]
    assert correlated_poses(white) == 1.0
    assert 10.0 < correlated_poses(slow) < 30.0  # (1 + 0.9) / (1 - 0.9) = 19
    assert correlated_poses(np.zeros((50, 3))) == 1.0
    drift = np.linspace(-1.0, 1.0, 60)[:, None] * np.ones(3)
    assert correlated_poses(drift) == 10.0
    # the same on real sweeps: a slow tremor of the tip, as large as the noise
    poses = pose_sweep(np.random.default_rng(1), 5, DEPTH, n=200)
    tremor = np.cumsum(rng.normal(0.0, 0.15, (200, 3)), axis=0)
    tremor -= tremor.mean(axis=0)
    moved = Poses(poses.rotations, poses.translations + tremor)
    still, slid = (calibrate(p, dof=5) for p in (poses, moved))
    grown = slid.tip_sigma_mm / still.tip_sigma_mm
    assert grown > 1.5 * slid.marker_sigma_mm / still.marker_sigma_mm


def test_the_longest_run_is_found_across_small_gaps():
    assert longest_run([5]) == (5, 5)
    assert longest_run([1, 9, 10, 12, 13, 40]) == (9, 13)


def test_the_tip_of_the_sweeps_is_right():
    found = calibrate(pose_sweep(np.random.default_rng(1), 6, DEPTH, n=300, cone_deg=40.0))
    assert np.linalg.norm(found.tip_pointermarker - TIPS[6]) < 0.2
