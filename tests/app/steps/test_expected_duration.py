"""Step 7 tells how long the scan will take before its motion is planned."""

import pytest

from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.procedure import stages
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.roll.view import expected_duration
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.compose import new_workbench, run_demo
from rona_core.session.document import Session

SHARE = 0.1  # as stated


def duration_s(session: Session) -> float:
    """Return what was planned and certified."""
    plan = session.results.roll.value
    assert plan.may_move
    return plan.trajectory.duration_s


def test_it_is_known_before_the_plan_and_told_beside_it_after(demo: Session) -> None:
    before = demo.with_result("roll", None)
    row = next(r for r in quality_rows({}, before) if r.key == "scan_duration_predicted_s")
    assert row.value == expected_duration(before) == expected_duration(demo)
    assert row.value == pytest.approx(duration_s(demo), rel=SHARE)
    assert expected_duration(Session()) is None


def test_a_slower_scan_takes_longer_and_a_shorter_path_less(demo: Session) -> None:
    usual = expected_duration(demo)
    slow = expected_duration(handle(SetRobot(scan_speed_mm_per_s=10.0), demo))
    assert slow > usual + 15.0
    fewer = expected_duration(handle(SmoothScanPath(tolerance_mm=3.0), demo))
    assert fewer < usual


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7101, 7102, 7103, 7104])
def test_other_patients_are_scanned_in_that_time(seed: int) -> None:
    session, _ = run_demo(seed, among=stages("roll"))
    assert expected_duration(session) == pytest.approx(duration_s(session), rel=SHARE)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [12.0, 30.0])
def test_at_other_speeds_it_takes_that_time(demo: Session, speed: float) -> None:
    bench = new_workbench(demo)
    try:
        bench.dispatch(SetRobot(scan_speed_mm_per_s=speed))
        bench.run(StartRollSearch(n_rolls=12))
        found = bench.session
    finally:
        bench.close()
    assert expected_duration(found) == pytest.approx(duration_s(found), rel=SHARE)
