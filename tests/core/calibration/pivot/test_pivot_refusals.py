"""Every cause for which poses determine no tip: its words, and its remedy, which is applied."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.calibration.handheld.pointer import calibrate_recorded_pivot
from rona_core.calibration.pivot.motion_extent import REFUSALS
from rona_core.calibration.pivot.pivot_calibration import solve_pivot
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Poses
from tests.helpers.pivot_data import BODY, TIP, poses

DOF = {"behind": 5}
LINE = np.array([[0.0, 0.0, -50.0], [0.0, 0.0, 50.0]])


def swing(angle_deg=25.0, seed=0, n=60, tip=TIP):
    return poses(seed, n=n, half_angle_deg=angle_deg, sigma_mm=0.1, tip=tip)[0]


def two_ways(one_deg, other_deg):
    """A swing by so many degrees in two directions, without spin."""
    s = np.linspace(0.0, 1.0, 60)
    turns = np.column_stack((one_deg * np.sin(9.0 * s), 0.0 * s, other_deg * np.cos(5.0 * s)))
    R = Rotation.from_rotvec(turns, degrees=True).as_matrix()
    noise = np.random.default_rng(0).normal(0.0, 0.05, (60, 3))
    return Poses(R, np.array((0.0, 0.0, 1500.0)) - R @ TIP + noise)


def held(stays):
    return swing().select(np.arange(60) // stays * stays)


def jumps(share=0.0):
    """A share of the poses, here and there, is far off and somewhere else each."""
    made, rng = swing(), np.random.default_rng(1)
    out = rng.permutation(60) < share * 60
    return Poses(made.rotations, made.translations + out[:, None] * rng.normal(0.0, 40.0, (60, 3)))


def slip(by_mm, *, tool=False):
    """From pose 25 on the tip is elsewhere in the tracker, or in the marker."""
    made = swing()
    by = np.where(np.arange(60)[:, None] >= 25, np.array((by_mm, 0.0, 0.0)), 0.0)
    if tool:
        by = np.einsum("nij,nj->ni", made.rotations, by)
    return Poses(made.rotations, made.translations + by)


def creep(by_mm):
    made = swing()
    rng = np.random.default_rng(2)
    return Poses(made.rotations, made.translations + rng.normal(0.0, by_mm, (60, 3)))


CASES = {  # cause: what shows it, and the same after what its remedy says
    "still": (lambda: two_ways(0.3, 0.3), lambda: two_ways(25.0, 25.0)),
    "repeated": (lambda: held(12), lambda: held(1)),
    "one plane": (lambda: two_ways(25.0, 0.5), lambda: two_ways(25.0, 25.0)),
    "small": (lambda: two_ways(1.5, 1.5), lambda: two_ways(20.0, 20.0)),
    "narrow": (lambda: spinning(3.0), lambda: spinning(20.0)),
    "slipped": (lambda: slip(25.0), lambda: slip(25.0).select(np.arange(25))),
    "loose": (
        lambda: slip(25.0, tool=True),
        lambda: slip(25.0, tool=True).select(np.arange(25, 60)),
    ),
    "disagree": (lambda: jumps(0.4), lambda: jumps()),
    "no common tip": (lambda: creep(20.0), lambda: creep(0.1)),
    "behind": (
        lambda: swing(tip=(0.0, 0.0, -160.0)),
        lambda: turned(swing(tip=(0.0, 0.0, -160.0))),
    ),
}


def spinning(angle_deg):
    """A narrow cone of a marker that spins much about its shaft."""
    rng, n = np.random.default_rng(0), 60
    shaft = Rotation.align_vectors([TIP / np.linalg.norm(TIP)], [[0.0, 0.0, 1.0]])[0]
    azimuths = rng.uniform(0.0, 2.0 * np.pi, n)
    tilts = np.deg2rad(angle_deg) * np.sqrt(rng.uniform(0.0, 1.0, n))
    tilt = tilts[:, None] * np.column_stack((np.cos(azimuths), np.sin(azimuths), np.zeros(n)))
    spin = np.column_stack((np.zeros((n, 2)), rng.uniform(-2.0, 2.0, n)))
    R = (shaft * Rotation.from_rotvec(tilt) * Rotation.from_rotvec(spin) * shaft.inv()).as_matrix()
    return Poses(R, np.array((0.0, 0.0, 1500.0)) - R @ TIP + rng.normal(0.0, 0.05, (n, 3)))


def turned(made):
    """The same with the z axis of the marker turned round."""
    return Poses(made.rotations @ np.diag((1.0, -1.0, -1.0)), made.translations)


def test_every_cause_has_a_case():
    assert set(CASES) == set(REFUSALS)
    assert all(words and remedy for words, remedy in REFUSALS.values())


@pytest.mark.parametrize("cause", CASES)
def test_the_cause_is_named_and_its_remedy_mends_it(cause):
    shows, mended = CASES[cause]
    dof = DOF.get(cause, 6)
    body = BODY if dof == 6 else LINE
    with pytest.raises(DegenerateGeometryError) as refused:
        solve_pivot(shows(), dof=dof, method="ml", at_least=10, positions_marker=body)
    assert refused.value.data["cause"] == cause
    assert str(refused.value).endswith(": " + REFUSALS[cause][1])
    bad = calibrate_recorded_pivot(shows(), dof=dof)
    assert (bad.verdict, bad.tip_marker) == ("bad", None)
    assert bad.reasons[0].endswith(": " + REFUSALS[cause][1])
    found = calibrate_recorded_pivot(mended(), dof=dof)
    assert found.verdict == "good", found.reasons


@pytest.mark.parametrize("tool", [False, True])
def test_place_and_size_of_a_move_are_in_the_words(tool):
    words = r"pose 24 (it|the tip) was (24|25)\.\d mm from where it was"
    with pytest.raises(DegenerateGeometryError, match=words):
        solve_pivot(slip(25.0, tool=tool), dof=6, method="ml", at_least=10, positions_marker=BODY)
