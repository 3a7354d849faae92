import pytest

from benchmarks.suites.implant.accepted_beds import STOPPING, AcceptedBed, Guarded
from benchmarks.suites.implant.force_guard import figures
from benchmarks.suites.implant.placement import interval


def bed(patient, left_mm, stopped=False, here_mm=1.5, searched=True):
    """Return a bed of a patient, for 1 mm, in which the force alone stops the burr, or nothing."""
    guarded = {name: Guarded(False, here_mm, left_mm, 0.0, 0.0) for name in STOPPING}
    guarded["force alone"] = Guarded(stopped, here_mm, left_mm, 0.0, 0.4 if stopped else 0.01)
    return AcceptedBed(patient, "BCI 602", searched, 1.0, 1.8, 0.995, left_mm, guarded)


def value(metrics, start, end=""):
    found = [one for one in metrics if one.name.startswith(start) and one.name.endswith(end)]
    assert len(found) == 1
    return found[0]


def test_a_stop_is_false_where_the_bed_keeps_its_limit_alone():
    beds = [bed(number, 1.2) for number in range(9)]
    beds += [bed(9, 1.0, stopped=True), bed(9, 0.9, stopped=True, here_mm=0.4)]
    metrics = list(figures(beds))
    assert value(metrics, "beds that keep their limit").value == 10.0
    false = value(metrics, "force alone: false stops (1 of 10)")
    assert false.value == pytest.approx(0.1)
    assert false.holds is False
    bound = value(metrics, "force alone: false stops, 95 % sure below").value
    assert bound == pytest.approx(interval(1, 10)[1])
    assert value(metrics, "force alone: false stops: patients with one (1 of 10)").value == 0.1
    assert value(metrics, "all guards: false stops (0 of 10)").holds is True
    others = "force alone, 1 beds that do not keep their limit"
    assert value(metrics, others, ": stops").value == 1.0
    assert value(metrics, others, "mm left").value == 1.0


def test_dura_that_is_reached_does_not_hold():
    metrics = list(figures([bed(0, -0.1, stopped=True, here_mm=-0.1)]))
    assert value(metrics, "force alone: dura reached").holds is False
    assert value(metrics, "as planned: least true residual").value == -0.1
    assert value(metrics, "force alone: false stops (0 of 0)").holds is None


def test_no_bed_is_no_figure():
    metrics = list(figures([]))
    assert value(metrics, "accepted beds rehearsed").value == 0.0
    assert value(metrics, "all guards: false stops (0 of 0)").holds is None
