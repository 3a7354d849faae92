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


@pytest.mark.parametrize(
    ("change", "below", "above"),
    [
        ("n_used", 20, 19),
        ("cone_deg", 10.0, 9.9),
        ("marker_sigma_mm", 1.0, 1.01),
        ("tip_sigma_mm", 0.5, 0.51),
        ("swing_deg", (5.0, 15.0), (5.0, 15.1)),
    ],
)
def test_limits_are_where_they_are_said_to_be(change, below, above):
    assert judge_pivot(replace(FINE, **{change: below}), NONE) == ("good", ())
    assert judge_pivot(replace(FINE, **{change: above}), NONE)[0] == "weak"


@pytest.mark.parametrize(("sigma_mm", "verdict"), [(1.9, "weak"), (2.0, "weak"), (2.1, "bad")])
def test_a_marker_that_errs_by_twice_what_is_large_makes_it_bad(sigma_mm, verdict):
    assert judge_pivot(replace(FINE, marker_sigma_mm=sigma_mm), NONE)[0] == verdict


@pytest.mark.parametrize(("alike", "told"), [(2.0, False), (2.1, True), (2.9, True), (3.1, True)])
def test_poses_that_share_their_error_are_told_of_beyond_two(alike, told):
    _, reasons = judge_pivot(replace(FINE, tip_sigma_mm=0.7, alike=alike), NONE)
    assert any("count as one" in reason for reason in reasons) is told


@pytest.mark.parametrize(("run", "slipped"), [(8, True), (7, False)])
def test_a_slip_is_four_fifths_of_what_is_rejected_in_one_run(run, slipped):
    scattered = 40 + 7 * np.arange(10 - run)
    rejected = np.concatenate((np.arange(10, 10 + run), scattered))
    _, (reason,) = judge_pivot(replace(FINE, n=80), rejected)
    assert ("the tip slipped there" in reason) is slipped
    assert f"10 of {80} poses are rejected" in reason


def test_every_cone_is_tried_and_the_error_falls_with_its_sine():
    for power in (1, 2):
        pairs = predicted_by_cone(replace(FINE, cone_deg=10.0, narrowness=power))
        assert [cone for cone, _ in pairs] == [10, 15, 20, 25, 30, 35, 40, 45]
        for cone, sigma in pairs:
            ratio = np.sin(np.deg2rad(10.0)) / np.sin(np.deg2rad(cone))
            assert sigma == pytest.approx(0.2 * ratio**power)


def test_memory_of_residuals_is_asked_for_twice_as_surely_at_the_first_neighbour():
    """A series whose first autocorrelation lies between one and two limits has none."""
    n = 200
    limit = 2.0 / np.sqrt(3.0 * n)
    white = np.random.default_rng(0).normal(size=(n, 3))
    for share in (1.3, 1.7):
        found = correlated_at(white, share * limit)
        assert correlated_poses(found) == 1.0
    assert correlated_poses(correlated_at(white, 2.5 * limit)) > 1.0


def correlated_at(white, wanted):
    """Mix a series with its neighbours until its first autocorrelation is as wanted."""
    low, high = -2.0, 2.0
    for _ in range(60):
        mix = 0.5 * (low + high)
        series = white.copy()
        series[1:] += mix * white[:-1]
        alike = (series[:-1] * series[1:]).sum() / (series**2).sum()
        low, high = (mix, high) if alike < wanted and abs(mix) < 1 else (low, mix)
    return series


@pytest.mark.parametrize("dof", [5, 6])
def test_the_sphere_states_its_narrowness_and_who_was_left_out(dof):
    """By a sphere the error falls with the square of the sine, by the markers with the sine."""
    poses = pose_sweep(np.random.default_rng(4), dof, EVEN, n=60, cone_deg=12.0)
    exclude = np.arange(60) % 20 == 3
    found = calibrate(poses, dof, method="sphere", exclude=exclude)
    assert [(r.index, r.reason) for r in found.rejected] == [
        (3, "excluded by hand"),
        (23, "excluded by hand"),
        (43, "excluded by hand"),
    ]
    sigma = found.tip_sigma_mm
    ratio = np.sin(np.deg2rad(found.cone_deg)) / np.sin(np.deg2rad(np.arange(10, 50, 5)))
    enough = np.arange(10, 50, 5)[(sigma * ratio**2 <= 0.5) & (ratio < 1.0)]
    if sigma > 0.5 and len(enough):
        assert f"sweep to {enough[0]} degrees" in found.reasons[0]


def test_at_the_widest_cone_so_many_more_poses_are_asked_for_as_halve_the_error():
    _, (reason,) = judge_pivot(replace(FINE, tip_sigma_mm=1.0, cone_deg=45.0), NONE)
    assert reason.endswith("record 4.0 times as many poses")
