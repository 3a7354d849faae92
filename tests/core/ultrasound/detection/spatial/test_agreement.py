"""What most of those around refuse that show the same boundary is not sure."""

import numpy as np
import pytest

from rona_core.ultrasound.detection.spatial.agreement import refused_around
from rona_core.ultrasound.detection.spatial.neighbours import scan_links
from tests.scenes.bone_surveys import detected, fired_again, stood_on

SIDE = 7
PLACES = np.stack(np.meshgrid(*[np.arange(float(SIDE))] * 2, [0.0]), axis=-1).reshape(-1, 3)
LINKS = scan_links(PLACES, SIDE**2)
ALL, NONE = np.ones(SIDE**2, dtype=np.bool_), np.zeros(SIDE**2, dtype=np.bool_)
MIDDLE = SIDE**2 // 2
STEP_SEED = 115  # hard and lossy: the step at 2 mm is heard, the inner boundary at 8 mm is not


def test_one_that_is_sure_among_many_that_are_not_is_refused():
    sure = NONE.copy()
    sure[MIDDLE] = True
    refused = refused_around(np.full(SIDE**2, 2.05), ALL, sure, LINKS)
    np.testing.assert_array_equal(np.flatnonzero(refused), [MIDDLE])


def test_what_is_refused_of_another_boundary_says_nothing():
    sure, thickness = NONE.copy(), np.full(SIDE**2, 2.05)
    sure[MIDDLE], thickness[MIDDLE] = True, 7.0
    assert not refused_around(thickness, ALL, sure, LINKS).any()


def test_where_most_are_sure_all_of_them_stay():
    sure = np.arange(SIDE**2) % 4 != 0
    assert not refused_around(np.full(SIDE**2, 7.0), ALL, sure, LINKS).any()


def test_those_that_show_nothing_have_no_say():
    sure = NONE.copy()
    sure[MIDDLE] = True
    assert not refused_around(np.full(SIDE**2, 7.0), sure, sure, LINKS).any()
    assert not len(refused_around(np.zeros(0), NONE[:0], NONE[:0], scan_links(None, 0)))


@pytest.mark.slow
def test_a_step_that_most_a_scans_refuse_is_kept_in_none():
    survey = stood_on(STEP_SEED, radius_mm=22.0)
    scene = fired_again(survey, "hard", loss=1.5)
    found = detected(survey, scene)
    true_mm = scene.bone_us * found.sound_speed_mm_per_us / 2.0
    wrong = found.inner_ok & (np.abs(found.thickness_mm - true_mm) > 1.0)
    assert found.inner_ok.mean() > 0.1
    assert not wrong.any()  # some without those around
