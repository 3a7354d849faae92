"""The example scripts do what they say, the one over REST against a real server."""

import pytest

from examples import compare_pointers, drive_over_rest, scan_by_hand
from rona_core.app.steps.handheld.messages import StartHandheldScan
from rona_core.app.steps.surface.messages import StartSurfaceCapture


@pytest.mark.ci
def test_the_harness_calibrates_the_pointer_over_rest(web):
    error_mm = drive_over_rest.main(f"http://127.0.0.1:{web.port}", web.token)
    (bench,) = [web.hub.get(i) for i in web.hub.ids() if web.hub.get(i).session.name == "harness"]
    assert bench.session.results.pointer.value.pointer == "pointer5d"
    assert error_mm == bench.figures()["pointer_tip_error_mm"]
    web.hub.close(bench.session.id)


@pytest.mark.slow
def test_the_comparison_names_both_pointers(capsys):
    compare_pointers.main(seeds=(0,), surface=StartSurfaceCapture(duration_s=10.0))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["pointer6d", "pointer5d"]
    assert all(0.0 < float(line.split()[2]) < 1.0 for line in lines)


@pytest.mark.slow
def test_the_scan_by_hand_prints_its_figures(capsys):
    quick = StartHandheldScan(duration_s=25.0, rate_hz=15.0, spacing_mm=4.0)
    figures = scan_by_hand.main(seed=4, scan=quick)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("probe: good")
    assert "of 375 A-scans" in lines[1]
    assert [line.split(":")[0] for line in lines[2:]] == list(figures)
    assert figures["sono_outer_rms_mm"] < 0.8
    assert figures["sono_coverage_fraction"] > 0.8
