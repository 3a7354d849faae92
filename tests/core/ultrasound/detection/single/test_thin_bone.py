import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rona_core.ultrasound.detection.detect import detect, nominal_bone
from rona_core.ultrasound.detection.single.front_echo import Fronts, fronts_at
from rona_core.ultrasound.detection.single.inner_echo import (
    bone_filter,
    merged_levels,
    thick_enough,
)
from rona_core.ultrasound.detection.single.matched_filter import BONE_REFLECTION, block_template
from rona_core.ultrasound.probe.probe_model import PROBES, ProbeSurvey, probe_model
from tests.scenes import bone_scenes

BONE = nominal_bone()
SEED = 900_000  # neither tuned with nor judged by
levels = st.floats(0.0, 2.0)


def echoes(template, thickness_mm, level):
    """Spectra of a front at time 0 and an inner echo behind it."""
    lag = 2.0 * thickness_mm / BONE.speed_mm_per_us
    behind = level * bone_filter(template, BONE, thickness_mm) * np.conj(template.shift([lag]))
    return BONE_REFLECTION * template.spectrum + behind


@pytest.mark.parametrize("name", sorted(PROBES))
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
def test_an_echo_in_the_front_is_seen_and_one_well_behind_it_is_not(name, excitation):
    probe = probe_model(name)
    template = block_template(probe, excitation)
    heard = Fronts(np.zeros(1), np.ones(1), np.full(1, 1e3), np.ones(1, dtype=bool))
    seen = [
        float(merged_levels(echoes(template, share * least, level), heard, template, BONE)[0])
        for least in (probe.min_thickness_mm,)
        for share, level in ((0.55, 1.0), (0.55, 0.5), (1.5, 1.0), (2.0, 0.3))
    ]
    assert 0.7 < seen[0] < 1.6
    assert seen[1] == pytest.approx(0.5 * seen[0], rel=1e-6)
    assert seen[2] < 0.1
    assert seen[3] < 0.01
    known = fronts_at(np.zeros(1), probe)
    assert merged_levels(echoes(template, 2.0, 1.0), known, template, BONE)[0] == 0.0


@given(merged=levels, more=levels, level=st.floats(0.01, 2.0))
def test_the_more_the_front_hides_the_less_is_believed(merged, more, level):
    low, high = thick_enough(np.array((merged, merged + more)), np.full(2, level))
    assert 0.0 <= high <= low <= 1.0
    assert thick_enough(np.array((merged,)), np.array((max(merged, 0.01),)))[0] == 1.0


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
