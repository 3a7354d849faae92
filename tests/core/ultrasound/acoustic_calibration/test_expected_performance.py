"""What a probe promises: the closed-form bound, its laws, and the depth range."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.echo_timing import spectrum_bound
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.acoustic_calibration.expected_performance import (
    expected_performance,
    expected_performances,
)
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, nominal_bone
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.probe.probe_model import probe_model


def test_sigma_is_the_bound_of_the_echo_in_the_noise_that_the_settings_name():
    settings = ProbeSettings(excitation="pulse", front_snr_db=36.0, shots=10)
    found = expected_performance(settings, (5.0,))
    probe = probe_model(settings)
    noise = 0.5 * 10 ** (-46 / 20) / np.sqrt(probe.bandwidth * probe.centre_mhz / 25.0)
    template = block_template(probe, "pulse")
    echo = bone_filter(template, nominal_bone(), 5.0)
    bound = spectrum_bound(echo, template.frequencies_mhz, noise)
    expected = bound.coherent_us * NOMINAL_SPEED_MM_PER_US / 2.0
    assert found.sigma_mm[0] == pytest.approx(expected, rel=1e-12)


def test_ten_times_less_noise_is_ten_times_less_sigma_and_20_db_more():
    quiet, loud = (expected_performance(ProbeSettings(front_snr_db=snr)) for snr in (60.0, 40.0))
    np.testing.assert_allclose(quiet.sigma_mm * 10.0, loud.sigma_mm, rtol=1e-9)
    np.testing.assert_allclose(quiet.snr_db - loud.snr_db, 20.0, atol=1e-9)
    assert quiet.most_mm > loud.most_mm


def test_deeper_is_worse_and_a_chirp_is_better():
    rows = {(row.probe, row.excitation): row for row in expected_performances(ProbeSettings())}
    assert len(rows) == 4
    for row in rows.values():
        assert (np.diff(row.sigma_mm) > 0).all()
        assert row.reaches(5.0)
        assert not row.reaches(20.0)
    for probe in ("2.25MHz", "1MHz"):
        assert (rows[probe, "chirp"].sigma_mm < rows[probe, "pulse"].sigma_mm).all()
        assert rows[probe, "chirp"].most_mm >= rows[probe, "pulse"].most_mm


def test_what_was_edited_counts_for_its_own_probe():
    settings = ProbeSettings(bandwidth=0.7)
    for plain, edited in zip(
        expected_performances(ProbeSettings()), expected_performances(settings), strict=True
    ):
        same = np.array_equal(plain.sigma_mm, edited.sigma_mm)
        assert same == (plain.probe != settings.name)
    chosen = expected_performances(settings)[1]
    own = expected_performance(replace(settings, excitation="chirp"))
    np.testing.assert_array_equal(chosen.sigma_mm, own.sigma_mm)


def test_too_much_noise_leaves_no_depth():
    assert expected_performance(ProbeSettings(front_snr_db=0.0, shots=1)).most_mm < 2.0


@pytest.mark.parametrize("wrong", [(0.0,), (-1.0, 3.0), (50.0,)])
def test_impossible_thicknesses_are_refused(wrong):
    with pytest.raises(InvalidInputError, match="thicknesses"):
        expected_performance(ProbeSettings(), wrong)
