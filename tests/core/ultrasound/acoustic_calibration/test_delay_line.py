"""The delay line on a block: its delay comes back, with temperature, and moves what is detected."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.ultrasound.acoustic_calibration.delay_line import (
    calibrate_delay_line,
    calibrated_probe,
)
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.beam import mirror_spectrum
from rona_core.ultrasound.probe.excitation import GRID, emission_spectrum, grid_frequencies_mhz
from rona_core.ultrasound.probe.materials import GEL
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model

PROBE = probe_model("2.25MHz")


def on_block(delay_us, n=20, *, level=0.9, noise=1e-3, jitter_us=0.001, seed=0, second=None):
    """Return A-scans of a mirror behind a line of that delay; ``second`` adds a late echo."""
    rng = np.random.default_rng(seed)
    f = grid_frequencies_mhz(PROBE)
    echo = emission_spectrum(PROBE, "pulse") * mirror_spectrum(PROBE)
    echo = echo / np.abs(np.fft.irfft(echo, GRID)).max() * level
    scans = []
    for _ in range(n):
        late = delay_us + rng.normal(0.0, jitter_us) - PROBE.start_us
        shape = echo * np.exp(-2j * np.pi * f * late)
        if second is not None:
            shape = shape * (1.0 - 0.15 * np.exp(-2j * np.pi * f * second))
        rf = np.fft.irfft(shape, GRID)[: PROBE.n_samples("pulse")]
        scans.append(
            AScan(
                0.0, rf + rng.normal(0.0, noise, len(rf)), PROBE.sampling_mhz, PROBE.start_us, False
            )
        )
    return AScanTrack.from_scans(scans)


@pytest.mark.parametrize("off_us", [-0.4, 0.0, 0.25])
def test_the_delay_comes_back(off_us):
    true = PROBE.line_delay_us + off_us
    line = calibrate_delay_line([on_block(true)], [22.0], PROBE, "pulse")
    assert line.delay_us == pytest.approx(true, abs=0.003)
    assert (line.n_used, line.n_rejected, line.slope_measured) == (20, 0, False)
    assert line.verdict == "weak"
    assert "one temperature" in line.reasons[0]


def test_several_temperatures_give_the_coefficient():
    kelvin = [18.0, 23.0, 30.0]
    tracks = [on_block(PROBE.line_delay_us + 0.1 + 0.03 * (t - 20.0), seed=int(t)) for t in kelvin]
    line = calibrate_delay_line(tracks, kelvin, PROBE, "pulse")
    assert line.slope_measured
    assert line.slope_us_per_k == pytest.approx(0.03, abs=3e-4)
    assert line.at(20.0)[0] == pytest.approx(PROBE.line_delay_us + 0.1, abs=0.004)
    assert line.at(40.0)[1] > line.at(24.0)[1] > 0
    assert line.at(24.0)[1] * GEL.speed_mm_per_us / 2.0 < 0.01  # of the outer boundary, in mm
    assert (line.verdict, line.reasons) == ("good", ())


def test_a_film_that_is_known_is_taken_off():
    plain = calibrate_delay_line([on_block(PROBE.line_delay_us)], [20.0], PROBE, "pulse")
    film = calibrate_delay_line(
        [on_block(PROBE.line_delay_us)], [20.0], PROBE, "pulse", film_mm=0.15
    )
    assert plain.delay_us - film.delay_us == pytest.approx(0.2, abs=1e-9)


def test_a_calibrated_probe_moves_the_outer_boundary_and_not_the_thickness():
    true = PROBE.line_delay_us + 0.3
    line = calibrate_delay_line([on_block(true)], [20.0], PROBE, "pulse")
    better = calibrated_probe(PROBE, line, 20.0)
    assert better.line_delay_us == pytest.approx(line.delay_us, abs=1e-12)
    assert replace(better, line=PROBE.line, timed_for_us=None) == PROBE
    track = on_block(true + 0.1, level=0.4, second=4.0, seed=5)  # bone in front of which gel lies
    before, after = (
        detect(ProbeSurvey(track, PROBE, "pulse")),
        detect(ProbeSurvey(track, better, "pulse")),
    )
    np.testing.assert_allclose(before.outer_us, after.outer_us, atol=2e-3)  # times stay
    moved = before.standoff_mm - after.standoff_mm
    np.testing.assert_allclose(moved, 0.3 * 1.5 / 2, atol=0.03)
    np.testing.assert_allclose(after.thickness_mm, before.thickness_mm, atol=0.2)


def test_what_scans_badly_is_left_out_and_what_cannot_be_is_bad():
    mixed = AScanTrack.from_scans(
        [
            AScan(0.0, np.array(row, dtype=float), PROBE.sampling_mhz, PROBE.start_us, False)
            for track in (
                on_block(PROBE.line_delay_us, 17),
                on_block(PROBE.line_delay_us + 0.5, 3, seed=2),
            )
            for row in track.rf
        ]
    )
    line = calibrate_delay_line([mixed], [20.0], PROBE, "pulse")
    assert (line.n_used, line.n_rejected) == (17, 3)
    far = calibrate_delay_line([on_block(PROBE.line_delay_us + 1.6)], [20.0], PROBE, "pulse")
    assert far.verdict == "bad"
    assert "another echo" in far.reasons[0]
    with pytest.raises(InvalidInputError, match="cannot be used"):
        calibrated_probe(PROBE, far, 20.0)
    faint = calibrate_delay_line([on_block(PROBE.line_delay_us, level=0.2)], [20.0], PROBE, "pulse")
    assert any("height expected" in reason for reason in faint.reasons)


def test_air_noise_and_wrong_input_are_refused():
    good = on_block(PROBE.line_delay_us, 4)
    with pytest.raises(DegenerateGeometryError, match="metal face"):
        calibrate_delay_line([on_block(PROBE.line_delay_us, 5, level=1e-4)], [20.0], PROBE, "pulse")
    with pytest.raises(DegenerateGeometryError, match="metal face"):  # air turns the echo over
        calibrate_delay_line([on_block(PROBE.line_delay_us, 5, level=-0.9)], [20.0], PROBE, "pulse")
    for tracks, kelvin, words in (
        ([], [], "capture for each"),
        ([good], [20.0, 25.0], "capture for each"),
        ([good], [80.0], "temperature"),
        ([good], [float("nan")], "temperature"),
        ([AScanTrack.from_scans([])], [20.0], "without A-scans"),
        ([replace(good, sampling_mhz=25.0)], [20.0], "sampled at 25"),
        ([replace(good, clipped=np.ones(4, dtype=bool))], [20.0], "lower the gain"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            calibrate_delay_line(tracks, kelvin, PROBE, "pulse")
    line = calibrate_delay_line([good], [20.0], PROBE, "pulse")
    with pytest.raises(InvalidInputError, match="is not that of"):
        calibrated_probe(probe_model("1MHz"), line, 20.0)
