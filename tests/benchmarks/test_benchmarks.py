"""What a benchmark says holds, it says by the rule; a list of figures is what readers expect."""

import contextlib
import importlib
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as program
from benchmarks import procedure_profile, timed_procedure
from benchmarks.cases.growth import exponent
from benchmarks.default_case import DEFAULT
from benchmarks.metric import Metric, cpu_ms, over_seeds
from benchmarks.smallest import SMALLEST, set_to
from benchmarks.suites.procedure import mounting, procedure
from rona_core.session.document import Session

pytestmark = pytest.mark.slow

KEYS = ["name", "value", "unit", "direction", "goal", "peer", "peer_value", "holds"]
# a suite can be run; what it is made of may stand beside it
SUITES = sorted((Path(program.__file__).parent / "suites").rglob("[!_]*.py"))
SUITES = [path for path in SUITES if "\ndef run(" in path.read_text()]


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
def test_json_is_a_list_of_figures_and_a_missed_goal_is_the_exit_status(
    monkeypatch, capsys, value, status
):
    metric = Metric("depth", value, "mm", "lower", 1.0, "paper", 1.5)
    monkeypatch.setattr(program, "run_suite", lambda name, *_, **__: [metric])
    assert program.main(["path", "robot", "--json"]) == status
    found = json.loads(capsys.readouterr().out)
    assert [list(entry) for entry in found] == [KEYS, KEYS]
    assert found[0] == metric.as_dict()
    assert program.main(["path", "--smallest"]) == 0  # its figures tell nothing
    table = capsys.readouterr().out.splitlines()
    assert any(line.startswith("depth") and "paper 1.5" in line for line in table)


def test_without_a_name_all_suites_run(monkeypatch, capsys):
    ran = []
    monkeypatch.setattr(program, "run_suite", lambda name, *_, **__: ran.append(name) or [])
    assert program.main([]) == 0
    assert ran == list(program.SUITES)
    assert dict(program.SUITES) == {path.stem: path.parent.name for path in SUITES}


@pytest.mark.sweep(8)
@pytest.mark.parametrize("name", program.SUITES)
def test_every_suite_gives_json_on_its_smallest_case(name, capsys):
    """Also without the peers it looks for: a figure beside one that is not here is null."""
    assert program.main([name, "--json", "--smallest"]) == 0

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    found = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert found
    assert all(list(entry) == KEYS for entry in found)
    for entry in found:
        for key in ("value", "goal", "peer_value"):
            assert entry[key] is None or type(entry[key]) is float, entry["name"]
        assert entry["holds"] in (None, True, False)
    assert any(entry["value"] is not None for entry in found)


def test_numbers_of_numpy_are_plain_in_json():
    """A comparison of NumPy's numbers is no bool of Python: ``echo_model`` ended with that."""
    for value in (np.float64(0.3), np.int64(1), np.float32(0.5), np.bool_(True)):
        metric = Metric("figure", value, "dB", "lower", 0.5, "peer", value)
        assert metric.holds is bool(value <= 0.5)
        found = json.loads(json.dumps(metric.as_dict(), allow_nan=False))
        assert found["value"] == found["peer_value"] == pytest.approx(float(value))
    for value in (np.nan, float("inf")):
        found = json.loads(json.dumps(Metric("f", value, "dB", "lower", 0.5).as_dict()))
        assert found["value"] is None
        assert found["holds"] is False


def test_smaller_cases_change_constants_that_are_there_and_give_them_back():
    assert set(SMALLEST) == set(program.SUITES)
    assert set(DEFAULT) <= set(program.SUITES)
    cases = [*SMALLEST.values(), *DEFAULT.values()]
    before = {}
    for values in cases:
        for place in values:
            module, _, name = place.rpartition(".")
            before[place] = getattr(importlib.import_module(f"benchmarks.{module}"), name)

    def now():
        parts = {place: place.rpartition(".") for place in before}
        modules = {m: importlib.import_module(f"benchmarks.{m}") for m, _, _ in parts.values()}
        return {place: getattr(modules[m], name) for place, (m, _, name) in parts.items()}

    for values in cases:
        with set_to(values):
            assert all(now()[place] is value for place, value in values.items())
        assert now() == before
    with contextlib.suppress(KeyboardInterrupt), set_to(values):
        raise KeyboardInterrupt
    assert now() == before


def test_the_default_leaves_out_what_full_runs_and_says_so(monkeypatch, capsys):
    whole, fewer = procedure.SEEDS, DEFAULT["procedure"]["suites.procedure.procedure.SEEDS"]
    assert set(fewer) < set(whole)
    seen = []
    monkeypatch.setattr(procedure, "run", lambda progress: seen.append(procedure.SEEDS) or [])
    for arguments in ([], ["--full"], ["--seeds", "2"], ["--full", "--seeds", "7"]):
        assert program.main(["procedure", *arguments]) == 0
    assert seen == [fewer, whole, range(2), range(7)]
    said = [x for x in capsys.readouterr().out.splitlines() if x.startswith("procedure: ")]
    assert said[:2] == [
        "procedure: fewer seeds than with --full",
        "procedure: the whole suite",
    ]
    with pytest.raises(SystemExit):
        program.main(["procedure", "--full", "--smallest"])


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_is_that_power(power):
    amounts = [3.0, 6.0, 12.0, 24.0]
    assert exponent(amounts, [0.2 * n**power for n in amounts]) == pytest.approx(power)


def test_a_step_that_doubles_no_longer_holds():
    kept = timed_procedure.kept_shares()
    assert sum(kept.values()) == pytest.approx(1.0, abs=0.001)

    def held(part, factor):
        spent_s = {**kept, part: kept[part] * factor}
        spent_s["roll"] -= spent_s[part] - kept[part]  # the whole stays what it was
        timed = timed_procedure.TimedProcedure(Session(name="x"), spent_s, 0.1)
        rows = {m.name: m.holds for m in timed_procedure.share_metrics(timed)}
        return rows[f"share of CPU, {part}"]

    for part in ("surface", "evaluation", "smoothing"):
        assert held(part, 1.9)
        assert not held(part, 2.1)


def test_a_profile_gives_the_time_of_libraries_to_those_who_called_them():
    ours = [(str(procedure_profile.ROOT / "rona_core" / f"{x}.py"), 1, x) for x in "ab"]
    numpy, below = ("numpy.py", 1, "norm"), ("~", 0, "<sqrt>")
    table = {
        ours[0]: (1, 1, 1.0, 4.0, {}),
        ours[1]: (1, 1, 2.0, 5.0, {}),
        numpy: (2, 2, 0.0, 4.0, {ours[0]: (1, 1, 0.0, 1.0), ours[1]: (1, 1, 0.0, 3.0)}),
        below: (2, 2, 4.0, 4.0, {numpy: (2, 2, 4.0, 4.0)}),
    }
    assert procedure_profile.own_times_s(table) == {ours[0]: 2.0, ours[1]: 5.0}


def test_so_many_seeds_are_taken_as_are_asked_for(monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(mounting, "run", lambda progress: seen.append(mounting.SEEDS) or [])
    first = mounting.SEEDS[0]
    assert program.main(["mounting", "--seeds", "8"]) == 0
    assert program.main(["mounting"]) == 0
    assert seen == [range(first, first + 8), mounting.SEEDS]
    with pytest.raises(SystemExit):
        program.main(["mounting", "--seeds", "0"])
    assert "at least one seed" in capsys.readouterr().err


def test_an_unknown_suite_is_refused_by_name(capsys):
    with pytest.raises(SystemExit):
        program.main(["pathh"])
    assert "pathh" in capsys.readouterr().err


def test_the_procedure_is_summed_up_over_runs():
    if importlib.util.find_spec("rona_core.compose") is None:
        pytest.skip("there is no procedure to run yet")
    from benchmarks.suites.procedure.procedure import Run, summary

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


def test_the_demonstration_is_checked_by_brute_force():
    if importlib.util.find_spec("rona_core.path.simplification.simplify") is None:
        pytest.skip("there is no smoothing yet")
    from benchmarks.suites.navigation.path import POINTS, demonstration, segment_deviation_mm

    points = demonstration(0)
    assert points.shape == (POINTS, 3)
    corner = np.array([[0.0, 0, 0], [1.0, 2.0, 0], [2.0, 0, 0]])
    assert segment_deviation_mm(corner, np.array([0, 2])) == pytest.approx(2.0)
    back = np.array([[0.0, 0, 0], [3.0, 0, 0], [2.0, 0, 0]])  # beyond the segment's end
    assert segment_deviation_mm(back, np.array([0, 2])) == pytest.approx(1.0)
