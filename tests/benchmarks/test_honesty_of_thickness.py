"""A small run of the case of thickness: what is stated holds, and reference points narrow it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.suites.honesty import thickness
from benchmarks.suites.honesty.judged import grouped
from rona_core.errors import DegenerateGeometryError
from rona_core.ultrasound.acoustic_calibration.speed_calibration import uncalibrated

SEEDS = (10_003, 10_007, 10_021)  # of those it was tuned with


@pytest.fixture(scope="module")
def samples():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(thickness, "RADIUS_MM", 18.0)
        return [one for seed in SEEDS for one in thickness.judge(seed)]


@pytest.mark.slow
def test_errors_of_patients_of_another_world_lie_in_their_bands(samples):
    for (name, part), group in grouped(samples).items():
        errors = np.concatenate([one.errors for one in group])
        sigmas = np.concatenate([one.sigmas for one in group])
        if len(errors) < 20:  # too few for a share
            assert (np.abs(errors) <= 3.0 * sigmas).all(), (name, part)
        else:
            assert np.mean(np.abs(errors) <= 1.96 * sigmas) > 0.85, (name, part)
        assert np.mean((errors / sigmas) ** 2) > 0.05, (name, part)  # and are no wider than needed
        if part == "local":
            assert all(abs(one.errors.mean()) < 1e-9 for one in group)


@pytest.mark.slow
def test_what_is_common_shrinks_with_reference_points_and_some_speeds_are_good(samples):
    groups = grouped(samples)
    common = {
        n: np.mean([one.sigmas[0] for one in groups[thickness_of(n), "common"]]) for n in (0, 3, 5)
    }
    assert common[5] < common[3] < 0.4 * common[0]
    good = groups["speed called good, 3 reference points (%)", "common"]
    assert all(one.sigmas[0] <= 1.5 for one in good)


@pytest.fixture(scope="module")
def timed_exactly():
    """A patient of 2.5 mm/us everywhere, whose times of flight are right."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(thickness, "RADIUS_MM", 18.0)
        patient = thickness.surveyed(10_003)
    true = patient.thickness_mm.copy()
    sure, found = patient.detection.inner_ok, patient.detection
    true[sure] = found.thickness_mm[sure] * 2.5 / found.sound_speed_mm_per_us
    return replace(patient, thickness_mm=true, speed_mm_per_us=np.full(len(true), 2.5))


@pytest.mark.slow
def test_a_speed_that_is_wrong_alike_everywhere_leaves_no_local_error(timed_exactly):
    found = thickness.thickness_errors(timed_exactly, uncalibrated())
    assert found.whole_mm.std() > 0.02  # thick places are more off than thin ones
    np.testing.assert_allclose(found.local_mm, 0.0, atol=1e-9)


@pytest.mark.ci
def test_a_place_whose_echo_is_late_is_off_by_itself(timed_exactly):
    late = timed_exactly.thickness_mm.copy()
    row = int(np.flatnonzero(timed_exactly.detection.inner_ok)[5])
    late[row] -= 0.4
    found = thickness.thickness_errors(replace(timed_exactly, thickness_mm=late), uncalibrated())
    share = 1.0 / len(found.local_mm)
    assert found.local_mm[5] == pytest.approx(0.4 * (1.0 - share))
    assert np.delete(found.local_mm, 5) == pytest.approx(-0.4 * share)


def thickness_of(points):
    return f"thickness of A-scans, {points} reference points (mm)"


def test_a_patient_of_whom_hardly_anything_is_heard_is_refused(monkeypatch):
    monkeypatch.setattr(thickness, "RADIUS_MM", 8.0)
    with pytest.raises(DegenerateGeometryError, match="hardly an A-scan"):
        next(thickness.judge(10_004))
