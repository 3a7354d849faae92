import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.pivot.pose_coverage import (
    RINGS_DEG,
    _words,
    next_best_pose,
    swing_coverage,
)
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Poses
from tests.helpers.pivots import GEOMETRY, TIPS, pose_sweep
from tests.helpers.strategies import seeds

few = settings(max_examples=15, deadline=None)
DEPTH = MarkerNoise()


def tilted(tilts_deg, azimuths_deg, dof=6):
    """Return poses whose shaft, upright in y, is tilted towards azimuths (0: +z, 90: +x)."""
    along = Rotation.from_euler("x", 180.0 if dof == 6 else 90.0, degrees=True)
    azimuths, tilts = np.deg2rad(azimuths_deg), np.deg2rad(tilts_deg)
    toward = np.column_stack((np.sin(azimuths), np.zeros(len(tilts)), np.cos(azimuths)))
    up = -(along.as_matrix() @ TIPS[dof]) / np.linalg.norm(TIPS[dof])
    turns = tilts[:, None] * np.cross(up, toward)
    R = (Rotation.from_rotvec(turns) * along).as_matrix()
    return Poses(R, np.array((0.0, 0.0, 1900.0)) - R @ TIPS[dof])


def ring(tilt_deg, step_deg=10.0):
    azimuths = np.arange(0.5 * step_deg, 360.0, step_deg)
    return tilted(np.full(len(azimuths), tilt_deg), azimuths)


def test_an_even_ring_has_its_tilt_and_no_gap():
    found = swing_coverage(ring(15.0), TIPS[6])
    assert found.rings_deg == RINGS_DEG
    np.testing.assert_allclose(found.tilts_deg, 15.0, atol=1e-6)
    np.testing.assert_allclose(np.diff(np.sort(found.azimuths_deg)), 10.0, atol=1e-6)
    assert found.gap_deg == pytest.approx(10.0, abs=1e-6)


def test_the_gap_of_a_swing_is_found_where_it_is():
    whole = swing_coverage(ring(20.0), TIPS[6])
    poses = ring(20.0)
    kept = (whole.azimuths_deg < 95.0) | (whole.azimuths_deg > 195.0)
    found = swing_coverage(poses.select(kept), TIPS[6])
    assert found.gap_deg > 80.0
    away = (found.gap_azimuth_deg - 145.0 + 180.0) % 360.0 - 180.0
    assert abs(away) < 15.0
    still = swing_coverage(tilted(np.zeros(5), np.zeros(5)), TIPS[6])
    assert still.gap_deg == 360.0


@given(seed=seeds)
@few
def test_tilts_are_those_of_the_shaft_from_the_middle(seed):
    poses = pose_sweep(np.random.default_rng(seed), 6, DEPTH, cone_deg=35.0)
    found = swing_coverage(poses, TIPS[6])
    shafts = poses.rotations @ (-TIPS[6] / np.linalg.norm(TIPS[6]))
    middle = shafts.mean(axis=0) / np.linalg.norm(shafts.mean(axis=0))
    np.testing.assert_allclose(np.cos(np.deg2rad(found.tilts_deg)), shafts @ middle, atol=1e-9)


def in_one_plane(azimuth_deg):
    """Return a swing to and fro along one azimuth, hardly across it."""
    tilts = np.array([20.0, 10.0, 1.0, 10.0, 20.0, 2.0])
    return tilted(tilts, azimuth_deg + np.array([0.0, 0.0, 90.0, 180.0, 180.0, 80.0]))


@pytest.mark.parametrize(
    ("azimuth", "sides"),
    [(90.0, ("away from the tracker", "towards the tracker")), (0.0, ("+x side", "-x side"))],
)
def test_the_next_pose_goes_across_a_swing_in_one_plane_and_words_say_where(azimuth, sides):
    poses = in_one_plane(azimuth)
    best = next_best_pose(poses, TIPS[6], GEOMETRY[6], dof=6, sigma_mm=0.35)
    assert best.tilt_deg == 30.0
    assert best.tip_sigma_mm < 0.8 * best.tip_sigma_before_mm
    chosen = [side for side in sides if side in best.words]
    assert len(chosen) == 1
    ways = {"away from the tracker": 0.0, "+x side": 90.0, "towards the tracker": 180.0}
    way = ways.get(chosen[0], 270.0)
    assert abs((best.azimuth_deg - way + 180.0) % 360.0 - 180.0) < 45.0


@pytest.mark.parametrize("dof", [6, 5])
@few
@given(seed=seeds)
def test_no_random_tilt_tells_more_than_the_best_one(dof, seed):
    rng = np.random.default_rng(seed)
    poses = pose_sweep(rng, dof, DEPTH, n=8, cone_deg=15.0)
    best = next_best_pose(poses, TIPS[dof], GEOMETRY[dof], dof=dof, sigma_mm=0.35)
    start = poses.mean().rotation
    before, after = [], []
    for azimuth in rng.uniform(0.0, 2.0 * np.pi, 5):
        # a tilt of the shaft by 30 degrees in any direction
        shaft = -(start @ TIPS[dof]) / np.linalg.norm(TIPS[dof])
        across = np.linalg.svd(shaft[None])[2][1:]
        axis = np.cos(azimuth) * across[0] + np.sin(azimuth) * across[1]
        R = Rotation.from_rotvec(np.deg2rad(30.0) * axis).as_matrix() @ start
        more = Poses(
            np.concatenate((poses.rotations, R[None])), np.zeros((9, 3))
        )  # where it is does not matter to what it tells
        tried = next_best_pose(more, TIPS[dof], GEOMETRY[dof], dof=dof, sigma_mm=0.35)
        before.append(tried.tip_sigma_before_mm)
        after.append(best.tip_sigma_mm)
    assert (np.array(after) <= 1.02 * np.array(before)).all()  # the grid has steps of 30 degrees


def test_the_predicted_error_is_that_of_the_calibration():
    poses = pose_sweep(np.random.default_rng(3), 6, DEPTH)
    found = calibrate_pointer(poses, pointer="p", dof=6, positions_pointermarker=GEOMETRY[6])
    best = next_best_pose(
        poses, found.tip_pointermarker, GEOMETRY[6], dof=6, sigma_mm=found.marker_sigma_mm
    )
    assert best.tip_sigma_before_mm == pytest.approx(found.tip_sigma_mm, rel=0.06)


def test_along_the_line_of_sight_the_axes_of_the_tracker_are_named():
    R = Rotation.from_euler("x", 90.0, degrees=True).as_matrix()  # shaft along -z
    turns = Rotation.from_rotvec([[0.2, 0, 0], [-0.2, 0, 0], [0, 0.2, 0], [0, -0.2, 0]])
    poses = Poses(turns.as_matrix() @ R, np.zeros((4, 3)))
    best = next_best_pose(poses, TIPS[6], GEOMETRY[6], dof=6, sigma_mm=0.35)
    assert "counted from +y to +x of the tracker" in best.words


def test_what_has_no_answer_is_refused():
    one = ring(10.0).select([0, 0, 0])
    with pytest.raises(InvalidInputError, match="no poses"):
        swing_coverage(Poses.stack([]), TIPS[6])
    with pytest.raises(DegenerateGeometryError, match="no shaft"):
        swing_coverage(ring(10.0), np.zeros(3))
    with pytest.raises(DegenerateGeometryError, match="no middle"):  # upright and upside down
        swing_coverage(tilted((0.0, 180.0), (0.0, 0.0)), TIPS[6])
    with pytest.raises(DegenerateGeometryError, match="leave the tip open"):
        next_best_pose(one, TIPS[6], GEOMETRY[6], dof=6, sigma_mm=0.3)


def test_rings_end_at_round_tilts():
    assert RINGS_DEG == (0.0, 10.0, 20.0, 30.0, 45.0, 60.0)


UPRIGHT = np.array((0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("azimuth_deg", "words"),
    [
        (0.0, "away from the tracker"),
        (19.5, "away from the tracker"),
        (20.5, "away from the tracker and somewhat to its +x side"),
        (69.5, "to its +x side and somewhat away from the tracker"),
        (70.5, "to its +x side"),
        (109.5, "to its +x side"),
        (180.0, "towards the tracker"),
        (250.5, "to its -x side"),
        (330.0, "away from the tracker and somewhat to its -x side"),
        (340.5, "away from the tracker"),
    ],
)
def test_directions_are_said_by_their_nearest_sides(azimuth_deg, words):
    assert _words(azimuth_deg, UPRIGHT) == words


@pytest.mark.parametrize(("off", "by_number"), [(0.09, True), (0.11, False)])
def test_along_the_line_of_sight_directions_are_counted_in_degrees(off, by_number):
    axis = np.array((off, 0.0, np.sqrt(1.0 - off**2)))
    assert ("counted from +y to +x" in _words(30.0, axis)) is by_number


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 200.0])
def test_in_the_line_of_sight_azimuths_are_counted_from_y_to_x(azimuth_deg):
    """Most poses upright before the tracker, one tilted by 20 degrees towards an azimuth."""
    angle = np.deg2rad(azimuth_deg)
    toward = np.array((np.sin(angle), np.cos(angle), 0.0))
    sight = Rotation.from_euler("x", 90.0, degrees=True)  # the tip's direction becomes the z axis
    shaft = -(sight.as_matrix() @ TIPS[6]) / np.linalg.norm(TIPS[6])
    turn = Rotation.from_rotvec(np.deg2rad(20.0) * np.cross(shaft, toward))
    R = np.concatenate(
        (np.repeat(sight.as_matrix()[None], 200, 0), (turn * sight).as_matrix()[None])
    )
    found = swing_coverage(Poses(R, -R @ TIPS[6]), TIPS[6])
    assert found.tilts_deg[-1] == pytest.approx(20.0, abs=0.2)
    assert (found.azimuths_deg[-1] - azimuth_deg + 180.0) % 360.0 - 180.0 == pytest.approx(
        0, abs=0.5
    )
