"""The figures of a scan with the probe tilted: of A-scans, and of patients."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.suites.accuracy.passes import (
    RMS_MM,
    PassFigures,
    metrics,
    pass_figures,
    scan_errors,
)
from rona_core.session.document import Session
from tests.scenes import demo_parts

ONE = PassFigures(0.97, 0.4, (0.02, 0.004), 1.0, bed=True, rms_mm=dict.fromkeys(RMS_MM, 0.2))


def test_a_scans_that_are_off_are_those_of_the_evaluation(demo):
    errors_mm = scan_errors(demo)
    figures = demo_parts.figures()
    assert len(errors_mm) == len(demo.captures.scan.scans) + figures["second_pass_points"]
    off = float(np.mean(np.abs(errors_mm[demo.results.maps.value.inner_used]) > 0.5))
    assert off == pytest.approx(figures["unflagged_failure_fraction"])


def test_a_session_has_its_figures_and_an_empty_one_none(demo):
    found = pass_figures(demo, demo_parts.figures())
    figures = demo_parts.figures()
    disc = figures["inner_coverage_fraction"] / figures["coverage_fraction"]
    assert found.coverage == pytest.approx(disc, abs=0.03)
    assert found.bed
    assert found.rms_mm["outer_rms_mm"] == figures["outer_rms_mm"]
    assert 0.0 < found.ratio < 10.0
    assert pass_figures(Session(), {}) is None


def test_shares_are_of_all_patients_and_the_worst_one_is_told():
    worst = replace(ONE, coverage=0.5, off=(0.1, 0.05), bed=False)
    found = {metric.name: metric for metric in metrics([ONE, worst, ONE, None])}
    assert found["patients without maps, of 4"].value == 1
    assert found["patients with at least 0.95 of the inner map"].value == pytest.approx(0.5)
    assert found["patients with an implant bed"].value == pytest.approx(0.5)
    few = found["patients with at most 0.5 % A-scans in the inner map off by more than 1 mm"]
    assert few.value == pytest.approx(0.5)
    assert not few.holds
    most = found["A-scans in the inner map off by more than 1 mm, largest share of a patient"]
    assert most.value == pytest.approx(0.05)
    assert not most.holds
    assert not list(metrics([None]))[1].holds
