"""The bed of an implant is moved by clicking the skull: message, outline, panel."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.messages.message import message_from
from rona_core.app.steps.implant.view import moved_bed
from rona_core.compose import new_workbench
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session
from rona_ui.presentation.snapshot import opens_window
from rona_ui.scene.implant import MOVED, MovedBedLayer, ring_base
from tests.ui.implant.test_implant_layers import drawn, looked_at
from tests.ui.implant.test_implant_panel import STEP, panel_of, snapshot
from tests.ui.panels.test_panels import CLIENT

MOVING = replace(STEP, drawing="implant")


def test_the_bed_goes_where_the_skull_was_clicked_and_asks_for_the_same(demo):
    held, outer = demo.results.get("bed"), demo.results.maps.value.outer
    place_base = outer.T_base_map @ np.array((3.0, -4.0, 1.0))
    sent = moved_bed(demo, place_base)
    before = message_from(held.message, dict(held.arguments))
    assert (sent.u_mm, sent.v_mm) == pytest.approx((3.0, -4.0))
    assert (sent.implant, sent.limit_mm, sent.burr_mm, sent.avoid) == (
        before.implant,
        before.limit_mm,
        before.burr_mm,
        before.avoid,
    )
    bench = new_workbench(demo)
    bench.dispatch(sent)
    placed = bench.session.results.get("bed").value
    bench.close()
    at, was = placed.placed.placement, held.value.placed.placement
    assert placed.lift_mm == held.value.lift_mm
    turned = (at.angle_rad - was.angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    assert turned == pytest.approx(0.0, abs=1e-3)
    offset = placed.placed.T_base_bed.translation - place_base
    normal = outer.T_base_map.rotation[:, 2]
    np.testing.assert_allclose(offset - (offset @ normal) * normal, 0.0, atol=0.01)


def test_moved_twice_it_ends_where_it_was_moved_last(demo):
    bench = new_workbench(demo)
    outer = demo.results.maps.value.outer
    for u_mm in (1.0, -2.0):
        bench.dispatch(moved_bed(bench.session, outer.T_base_map @ np.array((u_mm, 0.0, 0.0))))
    at = bench.session.results.get("bed").value.placed.placement
    bench.close()
    assert at.u_mm == pytest.approx(-2.0)


def test_without_a_bed_nothing_is_moved():
    with pytest.raises(StepBlockedError, match="place the implant bed"):
        moved_bed(Session(), (0.0, 0.0, 0.0))


def test_the_outline_is_at_the_mouse_while_the_bed_is_moved_and_then_gone(demo):
    placed = demo.results.get("bed").value.placed
    target = placed.T_base_bed.translation + (5.0, 2.0, 0.0)
    held = looked_at(demo, view=replace(MOVING, move_target=tuple(target)))
    nodes = drawn(MovedBedLayer, looked_at(demo, view=MOVING), held)
    rings = nodes.drawn[MOVED][0]
    np.testing.assert_allclose(
        rings - ring_base(held), np.broadcast_to((5.0, 2.0, 0.0), rings.shape)
    )
    assert MOVED not in drawn(MovedBedLayer, held, looked_at(demo, view=STEP)).drawn


def test_the_skull_is_whole_while_it_is_clicked(demo):
    assert opens_window(STEP)
    assert not opens_window(MOVING)


def test_the_panel_begins_and_ends_the_moving(demo):
    gui, recorder, panel = panel_of(snapshot(demo))
    gui.find("button", "Move on the skull").happen(CLIENT)
    assert recorder.shown.drawing == "implant"
    panel.render(snapshot(demo), snapshot(demo, view=MOVING))
    assert not gui.find("button", "Move on the skull").visible
    gui.find("button", "Done").happen(CLIENT)
    assert recorder.shown.drawing is None
    gui, _, _ = panel_of(snapshot(Session()))
    assert gui.find("button", "Move on the skull").disabled
