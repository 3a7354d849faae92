"""Bone that is thinner than the probe resolves: its second echo is not taken for thick bone."""

import numpy as np
import pytest

from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey
from tests.scenes import bone_scenes

SEED = 900_000  # neither tuned with nor judged by


@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
def test_the_second_echo_of_thin_bone_is_not_taken_for_thick_bone(excitation):
    scene = bone_scenes.parallel_bone(
        2.2, name="1MHz", excitation=excitation, patches=1, nominal=False, drawn_seed=SEED
    )[0]
    found = detect(
        ProbeSurvey(scene.track, scene.probe, excitation, positions_mm=scene.points_skull)
    )
    doubled = np.abs(found.thickness_mm / scene.thickness_mm - 2.0) < 0.2
    assert doubled.mean() > 0.8  # nothing else is there to be found
    assert not np.any(found.inner_ok)
