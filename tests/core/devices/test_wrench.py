"""A contact scan in figures: what counts as being on the path, and a curve over path or time."""

import numpy as np

from rona_core.app.steps.scan.view import live_force
from rona_core.devices.wrench import (
    APPROACH,
    CONTACT,
    LOST,
    RETRACT,
    STATES,
    STOPPED,
    LoopRow,
    ToolLoad,
    WrenchSample,
    force_now,
    force_track,
    summarize,
)
from rona_core.session.document import Session
from rona_ui.panels.scan.scan import FILLS, force_data, force_key, graph_axes

LOAD = ToolLoad(1.0, np.zeros(3), np.zeros(6), 0.0, 0.0, 6)


def rows(*steps):
    """Rows of (force, state, travel, feed, way), 0.1 s apart."""
    return [
        LoopRow(WrenchSample(0.1 * i, np.zeros(6)), force, state, travel, feed, way)
        for i, (force, state, travel, feed, way) in enumerate(steps)
    ]


def track(*steps, reason=""):
    return force_track(
        rows(*steps),
        setpoint_n=3.0,
        stiffness_n_per_mm=2.0,
        band_mm=5.0,
        load=LOAD,
        reason=reason,
    )


def test_only_steps_on_the_path_count_for_the_deviation_and_all_for_the_peak():
    found = summarize(
        track(
            (5.0, APPROACH, 0.0, 0.0, 0.0),
            (9.0, CONTACT, 9.0, 0.1, 0.0),  # pressed on, but not on its way
            (3.4, CONTACT, -1.0, 1.0, 1.0),
            (2.6, CONTACT, 2.0, 0.5, 2.0),
            (7.0, RETRACT, 0.0, 1.0, 2.0),
        )
    )
    assert np.isclose(found.rms_n, 0.4)
    assert found.peak_n == 9.0
    assert (found.travel_low_mm, found.travel_high_mm) == (-1.0, 2.0)
    assert np.isclose(found.mean_share, 0.75)
    assert (found.lost_s, found.stopped) == (0.0, False)


def test_lost_contact_and_a_stop_are_told():
    found = summarize(
        track(
            (3.0, CONTACT, 0.0, 1.0, 1.0),
            (0.0, LOST, 0.0, 0.0, 1.0),
            (0.0, LOST, 1.0, 0.0, 1.0),
            (0.0, STOPPED, 1.0, 0.0, 1.0),
            reason="contact was lost",
        )
    )
    assert np.isclose(found.lost_s, 0.2)
    assert (found.stopped, found.reason) == (True, "contact was lost")


def test_without_contact_there_is_nothing_to_sum_up():
    assert summarize(track((0.1, APPROACH, 0.0, 1.0, 0.0))) is None


def test_the_graph_shades_each_state_where_it_is_and_names_no_other():
    now = force_now(rows(*((f, s, 0.0, 1.0, 0.0) for f, s in ((0.1, 1), (3.1, 2), (0.0, 3)))), 3.0)
    curve = live_force(Session(), now)
    assert curve.at[-1] == 0.0
    assert curve.states == ("approach", "contact", "lost")
    _, *columns = force_data(curve)
    high = graph_axes(curve)[1].high
    for word, column in zip(FILLS, columns, strict=False):
        on = np.array([STATES[code] == word for code in now.states])
        np.testing.assert_array_equal(column, np.where(on, high, 0.0))
    named = {word for _, word in force_key(curve)}
    assert {"approach", "lost"} <= named
    assert not {"retract", "stopped"} & named
    assert curve.force_n.max() < high
