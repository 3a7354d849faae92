"""What a benchmark says holds, it says by the rule; a list of figures is what readers expect."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as program
from benchmarks.metric import Metric, cpu_ms, over_seeds

KEYS = ["name", "value", "unit", "direction", "goal", "peer", "peer_value", "holds"]
SUITES = sorted((Path(program.__file__).parent / "suites").glob("[!_]*.py"))


@pytest.mark.parametrize(
    ("value", "direction", "goal", "peer_value", "holds"),
    [
        (1.0, "lower", 1.0, None, True),
        (1.01, "lower", 1.0, None, False),
        (1.0, "higher", 1.0, None, True),
        (0.99, "higher", 1.0, None, False),
        (1.0, "lower", None, None, None),
        (1.0, "lower", None, 0.9, False),  # without a goal the peer is the bound
        (1.0, "lower", 1.5, 0.9, True),  # with one, it stands beside
        (None, "lower", 1.0, None, False),  # nothing measured is not a success
        (float("nan"), "lower", 1.0, None, False),
        (None, "lower", None, None, None),
    ],
)
def test_a_figure_holds_by_its_goal_or_its_peer(value, direction, goal, peer_value, holds):
    peer = None if peer_value is None else "somebody"
    metric = Metric("figure", value, "mm", direction, goal, peer, peer_value)
    assert metric.holds is holds
    assert list(metric.as_dict()) == KEYS
    assert metric.as_dict()["holds"] is holds


def test_over_seeds_gives_median_and_worst_of_what_is_there():
    low = over_seeds("a", [3.0, None, 1.0, 2.0], "mm", "lower", goal=2.0)
    assert [m.value for m in low] == [2.0, 3.0]
    assert [m.holds for m in low] == [True, None]
    assert low[1].name == "a (worst of 3)"
    high = over_seeds("a", [3.0, 1.0, 2.0], "share", "higher", goal=2.5)
    assert [m.value for m in high] == [2.0, 1.0]
    assert high[0].holds is False
    assert over_seeds("a", [None], "mm", "lower", goal=1.0)[0].holds is False


def test_the_clock_counts_work_and_takes_the_best():
    calls = []
    assert cpu_ms(lambda: calls.append(sum(range(1000))), repeats=3) >= 0.0
    assert len(calls) == 3


@pytest.mark.parametrize(("value", "status"), [(0.5, 0), (2.0, 1)])
def test_json_is_a_list_of_figures_and_the_gate_is_the_exit_status(
    monkeypatch, capsys, value, status
):
    metric = Metric("depth", value, "mm", "lower", 1.0, "paper", 1.5)
    monkeypatch.setattr(program, "run_suite", lambda name: [metric])
    assert program.main(["path", "robot", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [list(entry) for entry in found] == [KEYS, KEYS]
    assert found[0] == metric.as_dict()
    assert program.main(["path", "--gate"]) == status
    table = capsys.readouterr().out.splitlines()
    assert any(line.startswith("depth") and "paper 1.5" in line for line in table)


def test_without_a_name_all_suites_run(monkeypatch, capsys):
    ran = []
    monkeypatch.setattr(program, "run_suite", lambda name: ran.append(name) or [])
    assert program.main([]) == 0
    assert ran == list(program.SUITES)
    assert sorted(program.SUITES) == [path.stem for path in SUITES]


def test_an_unknown_suite_is_refused_by_name(capsys):
    with pytest.raises(SystemExit):
        program.main(["pathh"])
    assert "pathh" in capsys.readouterr().err


def test_the_procedure_is_summed_up_over_runs():
    if importlib.util.find_spec("rona_core.compose") is None:
        pytest.skip("there is no procedure to run yet")
    from benchmarks.procedure_table import page
    from benchmarks.suites.procedure import Run, summary

    good = {"completed": True, "surface_rms_mm": 1.0, "outer_rms_mm": 0.5, "wall_s": 10.0}
    bad = {"completed": False, "failed_step": "roll", "surface_rms_mm": 2.5, "outer_rms_mm": None}
    done = [*(Run("simulated", seed, good) for seed in range(8)), Run("skull_c", 0, bad)]
    found = {metric.name: metric for metric in summary(done)}
    assert found["surface_rms_mm (median)"].value == 1.0
    assert found["surface_rms_mm (worst of 9)"].value == 2.5
    assert found["outer_rms_mm (worst of 8)"].value == 0.5
    assert found["completed, of 9"].value == 8.0
    assert found["completed, of 9"].goal == 7.0
    assert found["completed, of 9"].holds is True
    text = page(done)
    assert text.count("| simulated |") == 8
    assert "no: roll" in text


def test_the_demonstration_is_checked_by_brute_force():
    if importlib.util.find_spec("rona_core.path.smooth") is None:
        pytest.skip("there is no smoothing yet")
    from benchmarks.suites.path import POINTS, demonstration, segment_deviation_mm

    points = demonstration(0)
    assert points.shape == (POINTS, 3)
    corner = np.array([[0.0, 0, 0], [1.0, 2.0, 0], [2.0, 0, 0]])
    assert segment_deviation_mm(corner, np.array([0, 2])) == pytest.approx(2.0)
    back = np.array([[0.0, 0, 0], [3.0, 0, 0], [2.0, 0, 0]])  # beyond the segment's end
    assert segment_deviation_mm(back, np.array([0, 2])) == pytest.approx(1.0)
