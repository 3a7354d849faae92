"""The frame graph in the dock: what is drawn, what is said beside it, and never by colour alone."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from rona_core.app.overview.frame_graph import FrameRow, frame_rows
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import MoveTracker, SetTracker, SetUseBaseMarker
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_workbench
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.panels.layout.frames_and_log import (
    CHAR_PX,
    EXPECTED,
    HALF_HEIGHT,
    PLACES,
    WIDTH,
    frame_picture,
    frames_table,
)
from tests.helpers.strategies import angle_rad

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def bench():
    bench = new_workbench(Session())
    bench.dispatch(SetTracker(rate_hz=20.0, occlusion=False))
    bench.run(StartToolCapture(n_pivot=8, n_translate=3))
    bench.run(StartPointerCapture(duration_s=5.0))
    yield bench
    bench.close()


def tree(rows):
    """The picture, parsed as strictly as XML is."""
    return ElementTree.fromstring(
        frame_picture(rows).replace("<svg ", f'<svg xmlns="{SVG[1:-1]}" ', 1)
    )


def lines(rows, kind):
    return [line for line in tree(rows).iter(f"{SVG}line") if line.get("class") == kind]


def test_every_transform_is_an_arrow_with_the_number_of_its_line_in_the_list(bench):
    rows = frame_rows(bench.session, bench.live.get())
    assert len(lines(rows, "known")) + len(lines(rows, "live")) == len(rows)
    titles = [title.text for title in tree(rows).iter(f"{SVG}title")][1:]
    assert titles == [f"{n}: {row.name}" for n, row in enumerate(rows, start=1)]
    listed = re.findall(r"(\d+)\. <b>(\w+)</b>", frames_table(rows))
    assert listed == [(str(n), row.name) for n, row in enumerate(rows, start=1)]


def test_what_is_not_known_yet_is_a_faint_line_without_a_number(bench):
    before, after = frame_rows(Session()), frame_rows(bench.session)
    assert len(lines(before, "unknown")) > len(lines(after, "unknown")) > 0
    assert "3 transforms known, 0 of them stale" in frame_picture(before)


def test_a_stale_transform_is_dashed_and_says_so(bench):
    rows = tuple(replace(row, stale_reason="<moved>") for row in frame_rows(bench.session))
    drawn = lines(rows, "stale")
    assert len(drawn) == len(rows)
    assert all(line.get("stroke-dasharray") for line in drawn)
    words = [text.text for text in tree(rows).iter(f"{SVG}text")]
    assert words.count("stale") == len(rows)
    listed = frames_table(rows)
    assert listed.count("! stale: &lt;moved&gt;") == len(rows)
    assert "<moved>" not in listed + frame_picture(rows)


def test_source_time_and_error_are_listed(bench):
    rows = {row.name: row for row in frame_rows(bench.session)}
    tracker, tool = rows["T_base_tracker"], bench.session.results.tool.value
    assert tracker.source == "tool"
    assert tracker.sigma_mm == tool.registration_sigma_mm
    assert 0.0 < tracker.sigma_deg < 0.5
    entry = next(e for e in bench.session.log if e.message == "RegisterTool")
    assert tracker.time_utc == entry.time_utc
    assert rows["T_toolmarker_tip"].sigma_mm == tool.tip_sigma_mm
    assert rows["T_base_basemarker"].sigma_mm > 0.0
    assert rows["T_flange_tip"].sigma_mm is rows["T_flange_tip"].time_utc is None
    listed = frames_table(tuple(rows.values()))
    assert f"tool, {entry.time_utc[11:19]} UTC" in listed
    assert f"σ {tracker.sigma_mm:.2f} mm, {tracker.sigma_deg:.2g}°" in listed


def test_a_moved_tracker_is_stale_until_a_stroke_finds_it_again(bench):
    bench.run(StartSurfaceCapture(duration_s=3.0))
    bench.dispatch(MoveTracker((30.0, -20.0, 10.0), 1.0))

    def tracker():
        rows = frame_rows(bench.session)
        return next(row for row in rows if row.name == "T_base_tracker")

    before = tracker()
    assert "the next stroke finds it" in before.stale_reason
    bench.run(StartSurfaceCapture(duration_s=3.0))
    found = tracker()
    assert (found.source, found.stale_reason) == ("tool, base marker", None)
    assert found.time_utc >= before.time_utc
    assert angle_rad(found.pose, before.pose) > 0.01
    bench.dispatch(SetUseBaseMarker(use_base_marker=False))
    assert "register again" in tracker().stale_reason


def test_no_arrow_crosses_the_box_of_another_frame():
    edges = {*EXPECTED, ("base", "skull")}
    assert {frame for edge in edges for frame in edge} == set(PLACES)
    rows = tuple(FrameRow(*edge, "step", Pose.identity()) for edge in sorted(edges))
    for line, row in zip(lines(rows, "known"), rows, strict=True):
        x1, y1, x2, y2 = (float(line.get(key)) for key in ("x1", "y1", "x2", "y2"))
        for name, (x, y) in PLACES.items():
            if name in (row.parent, row.child):
                continue
            half = CHAR_PX * len(name) + 6.0
            for share in np.linspace(0.0, 1.0, 200):
                outside = (
                    abs(x1 + share * (x2 - x1) - x) > half
                    or abs(y1 + share * (y2 - y1) - y) > HALF_HEIGHT
                )
                assert outside, f"{row.name} crosses {name}"


def test_boxes_lie_inside_the_picture_and_apart():
    rows = [FrameRow("base", "skull", "surface", Pose.identity())]
    rows += [FrameRow("skull", f"other{i}", "step", Pose.identity()) for i in range(4)]
    parsed = tree(rows)
    height = float(parsed.get("viewBox").split()[3])
    boxes = [
        tuple(float(rect.get(key)) for key in ("x", "y", "width", "height"))
        for rect in parsed.iter(f"{SVG}rect")
    ]
    assert len(boxes) == len(PLACES) + 4
    for x, y, w, h in boxes:
        assert x >= 0.0
        assert y >= 0.0
        assert x + w <= WIDTH
        assert y + h <= height
    for (x, y, w, h), (u, v, s, t) in combinations(boxes, 2):
        assert x + w <= u or u + s <= x or y + h <= v or v + t <= y
