"""Records that cannot carry the answer: too few samples a cycle, begun late, ended early.

Law: wherever a record is cut and however it is thinned out, each line is right, or it is flagged,
or the record is refused with the cause.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.steps.scan.rf_report import report_rf
from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.recorded.plate_detector import CUT_OFF, detect_recorded

CENTRE_MHZ, RATE_MHZ, SPEED, PLATE_MM = 2.25, 90.0, 2.85, 6.0
FIRST_US, LAST_US, LONG_US = 20.0, 38.0, 90.0
FRONT_US, BACK_US = 26.6, 26.6 + 2.0 * PLATE_MM / SPEED
WRONG_MM = 0.3
AWKWARD = Path(__file__).parents[5] / "shared" / "data" / "awkward" / "rf"


def plate(last_us):
    """Return lines (24, samples) of a plate in water, from FIRST_US on."""
    rng = np.random.default_rng(42)
    time = np.arange(FIRST_US, last_us, 1.0 / RATE_MHZ)
    lines = 1e-3 * rng.standard_normal((24, len(time)))
    for row, standoff in enumerate(FRONT_US + rng.uniform(-0.15, 0.15, 24)):
        for trips, height in enumerate((1.0, -0.8, -0.35, -0.15)):
            at = time - standoff - trips * 2.0 * PLATE_MM / SPEED
            pulse = np.exp(-((at / 0.32) ** 2)) * np.cos(2.0 * np.pi * CENTRE_MHZ * at)
            lines[row] += height * pulse
    return lines


def record(first=0, last=None, every=1):
    rf = plate(LAST_US if every == 1 else LONG_US)[:, first:last:every]
    positions = np.linspace(0.0, 23.0, len(rf))[:, None]
    return RecordedRf(
        name="plate",
        rf=rf,
        sampling_mhz=RATE_MHZ / every,
        start_us=FIRST_US + first / RATE_MHZ,
        start_known=True,
        positions_mm=positions,
    )


def silently_wrong(found):
    return int((found.ok & (np.abs(found.thickness_mm - PLATE_MM) > WRONG_MM)).sum())


@pytest.mark.sweep(2)
@pytest.mark.parametrize("every", [1, 4, 8, 10])
def test_with_four_samples_a_cycle_the_plate_is_right(every):
    found = detect_recorded(record(every=every), SPEED)
    assert found.ok.all()
    assert silently_wrong(found) == 0


@pytest.mark.sweep(4)
@pytest.mark.parametrize("every", range(18, 60, 3))
def test_lines_whose_echoes_are_folded_are_refused_with_the_cause_or_flagged(every):
    cause = ""
    try:
        found = detect_recorded(record(every=every), SPEED)
    except InvalidInputError as error:
        cause = str(error)
    assert re.search("folded back.*4 or more samples in a cycle", cause) or not found.ok.any()


@pytest.mark.parametrize("around", [FRONT_US, BACK_US])
def test_a_record_that_begins_within_an_echo_is_right_or_flagged(around):
    for begin_us in np.arange(around - 0.6, around + 1.0, 0.1):
        found = detect_recorded(record(first=round((begin_us - FIRST_US) * RATE_MHZ)), SPEED)
        assert silently_wrong(found) == 0, begin_us


def test_a_record_that_ends_within_an_echo_is_right_or_flagged():
    flags = set()
    for end_us in np.arange(BACK_US - 0.6, BACK_US + 1.6, 0.1):
        found = detect_recorded(record(last=round((end_us - FIRST_US) * RATE_MHZ)), SPEED)
        assert silently_wrong(found) == 0, end_us
        flags |= set(found.flag.tolist())
    assert CUT_OFF in flags
    assert found.ok.all()  # two pulse lengths behind the echo it is whole


@pytest.mark.skipif(not AWKWARD.is_dir(), reason=f"no awkward recordings in {AWKWARD}")
def test_the_awkward_recordings_are_right_flagged_or_refused():
    def report(name):
        path = AWKWARD / f"{name}.npz"
        return report_rf(NamedFile(str(path), path.read_bytes()), 2850.0)

    assert report("plate_6mm").summary.mean_mm == pytest.approx(6.0, abs=0.005)
    late = report("begins_in_front").detection
    assert silently_wrong(late) == 0
    assert late.ok.any()
    with pytest.raises(InvalidInputError, match="folded back"):
        report("undersampled")
