from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.settings import ProbeSettings
from rona_core.ultrasound.detection.pass_standoff import LEAST_FRONTS, standoff_offset_mm
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.helpers.ultrasound_scenes import WavySkull, scan


@pytest.fixture(scope="module")
def tilted():
    """Return a pass with the probe tilted by 5°, and its true stand-offs."""
    settings = ProbeSettings()
    track, _, depths_mm = scan(WavySkull(3), settings, seed=5, width_mm=12.0, tilt_deg=5.0)
    survey = ProbeSurvey(track, probe_model("2.25MHz"), settings.excitation)
    return survey, depths_mm[:, 0]


@pytest.mark.parametrize("shift_mm", [-0.3, -0.1, 0.0, 0.05, 0.3])
def test_a_shift_of_all_front_echoes_is_found(tilted, shift_mm):
    survey, true_mm = tilted
    found = standoff_offset_mm(survey, true_mm - shift_mm)
    assert found == pytest.approx(shift_mm, abs=0.03)


def test_stand_offs_of_the_survey_itself_do_not_hide_the_shift(tilted):
    survey, true_mm = tilted
    known = true_mm - 0.2
    held = replace(survey, known_standoff_mm=known)
    assert standoff_offset_mm(held, known) == standoff_offset_mm(survey, known)


def test_one_stand_off_in_four_that_is_far_off_changes_nothing(tilted):
    survey, true_mm = tilted
    wrong = true_mm - 0.1
    wrong[::4] += np.random.default_rng(1).uniform(-3.0, 3.0, len(wrong[::4]))
    assert standoff_offset_mm(survey, wrong) == pytest.approx(0.1, abs=0.03)


def test_a_few_front_echoes_and_noise_say_nothing(tilted):
    survey, true_mm = tilted
    few, track = slice(0, LEAST_FRONTS - 1), survey.track
    part = replace(track, times_s=track.times_s[few], rf=track.rf[few], clipped=track.clipped[few])
    assert standoff_offset_mm(replace(survey, track=part), true_mm[few] - 0.3) == 0.0
    scale = np.abs(track.rf).max() / 100.0
    noise = np.random.default_rng(2).normal(0.0, scale, track.rf.shape).astype(track.rf.dtype)
    silent = replace(survey, track=replace(track, rf=noise))
    assert standoff_offset_mm(silent, true_mm - 0.3) == 0.0
