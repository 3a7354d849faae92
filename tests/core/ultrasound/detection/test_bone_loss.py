"""The loss of the bone is learned from its own echoes, whatever was assumed."""

import numpy as np
import pytest

from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.scenes.bone_surveys import fired_again, stood_on

SEEDS = (31_000, 31_001)


@pytest.fixture(scope="module", params=SEEDS)
def survey(request):
    return stood_on(request.param, radius_mm=12.0)


def detected(survey, loss, **given):
    track, settings = fired_again(survey, loss=loss).track, survey.settings
    places, axes = survey.Ts_skull_probe.translations, survey.Ts_skull_probe.rotations[:, :, 2]
    asked = ProbeSurvey(track, probe_model(settings), settings.excitation, places, axes)
    return detect(asked, **given)


@pytest.mark.ci
@pytest.mark.sweep(1)
def test_it_follows_the_loss_of_the_bone(survey):
    true = (0.7, 1.0, 1.5)
    learned = [detected(survey, loss).bone_loss for loss in true]
    # the beam spreads on its way as well, which counts as a loss
    assert learned[2] > learned[0] + 0.3
    np.testing.assert_allclose(learned, true, atol=0.6)


@pytest.mark.slow
def test_lossy_bone_is_seen_through_where_nominal_bone_hides_it(survey):
    learned, nominal, oracle = (
        detected(survey, 1.5, bone_loss=loss).inner_ok.mean() for loss in (None, 1.0, 1.5)
    )
    assert learned >= 0.6 * oracle
    assert learned > 2.0 * nominal


@pytest.mark.sweep(1)
def test_a_given_loss_is_taken_and_the_plain_methods_learn_none(survey):
    assert detected(survey, 1.0, bone_loss=0.8).bone_loss == 0.8
    assert detected(survey, 1.0, method="matched").bone_loss is None
