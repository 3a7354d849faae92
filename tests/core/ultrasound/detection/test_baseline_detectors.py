"""The detectors of the original system work as a reader of the paper would have them work."""

import numpy as np
import pytest

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.detection.baseline_detectors import rising_edges
from rona_core.ultrasound.detection.detect import NO_INNER, OK, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from tests.helpers.ultrasound_scenes import Plates, StillClock
from tests.scenes.bone_scenes import plate

CASES = [(name, kind) for name in ("2.25MHz", "1MHz") for kind in ("pulse", "chirp")]
EVERY = pytest.mark.parametrize(("name", "excitation"), CASES)
METHODS = pytest.mark.parametrize("method", ["matched", "threshold"])
SEEDS = (910_000, 920_000)  # other worlds than those the methods were made with


@pytest.mark.sweep(3)
@METHODS
@EVERY
def test_a_plain_plate_is_measured_in_every_shot(name, excitation, method):
    for seed in SEEDS:
        scene = plate(
            6.0, 40.0, name=name, excitation=excitation, n=40, nominal=False, drawn_seed=seed
        )
        found = detect(ProbeSurvey(scene.track, scene.probe, excitation), method=method)
        true_mm = scene.bone_us * found.sound_speed_mm_per_us / 2.0
        assert np.mean(found.flag == OK) > 0.9
        assert np.abs(found.thickness_mm - true_mm).max() < 0.6
        assert (found.thickness_mm - true_mm).std() < 0.15


@pytest.mark.sweep(2)
@METHODS
@EVERY
def test_where_the_bone_has_no_end_hardly_anything_is_taken_for_it(name, excitation, method):
    clock, specimen = StillClock(), Plates((0.0, 60.0, 70.0, 80.0))
    probe = VirtualProbe(
        clock, lambda times: Pose.identity().repeated(len(times)), specimen, Medium(speckle=0.0)
    )
    probe.begin(ProbeSettings(name=name, excitation=excitation), 5, 0)
    scans = []
    for shot in range(40):
        clock.time_s = 0.1 * shot
        scans.append(probe.acquire())
    found = detect(
        ProbeSurvey(AScanTrack.from_scans(scans), probe_model(name), excitation), method=method
    )
    assert found.outer_ok.all()
    assert np.mean(found.flag == NO_INNER) > 0.9


def test_edges_are_where_straight_flanks_cross_half_of_the_peak():
    level = np.array([[0.0, 1.0, 2.0, 3.0, 4.0, 1.0], [0.0, 0.0, 0.0, 4.0, 2.0, 0.0]])
    np.testing.assert_allclose(rising_edges(level, np.array((4, 3))), (2.0, 2.5))
