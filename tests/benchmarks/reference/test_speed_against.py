"""Two programs in turn: the ratio of a seed is to the mean of the runs around the older one's."""

from contextlib import nullcontext
from pathlib import Path

from benchmarks.reference import speed_against


def test_ratios_are_to_the_runs_around(monkeypatch, capsys):
    times = iter([2.0, 9.0, 4.0, 2.0, 12.0, 2.0, 1.0, 5.0, 1.0])
    asked = []

    def cpu_s(tree, seed):
        asked.append((tree.name, seed))
        return next(times)

    monkeypatch.setattr(speed_against, "cpu_s", cpu_s)
    monkeypatch.setattr(speed_against, "checked_out", lambda commit: nullcontext(Path(commit)))
    speed_against.main(["then", "--seeds", "4", "5", "6"])
    now = speed_against.ROOT.name
    assert asked[:3] == [(now, 4), ("then", 4), (now, 4)]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("then 9.0 s, now 3.0 s, 3.00")
    assert lines[-1] == "median of 3: 5.00 times as fast"
