"""The virtual axis and spring against step-by-step integration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.virtual.robot.contact_dynamics import ContactSpring, LaggingAxis


@settings(max_examples=20, deadline=None)
@given(
    speeds=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=12),
    delay_ms=st.floats(0.0, 50.0),
    lag_ms=st.floats(5.0, 60.0),
)
def test_the_axis_does_what_integration_says(speeds, delay_ms, lag_ms):
    axis, period_s, fine_s = LaggingAxis(delay_ms / 1000.0, lag_ms / 1000.0), 0.016, 1e-5
    for i, speed in enumerate(speeds):
        axis.command(i * period_s, speed)
    end_s = len(speeds) * period_s + 0.1
    times = np.arange(0.0, end_s, fine_s)
    sent = np.floor((times - delay_ms / 1000.0) / period_s + 1e-9).astype(int)
    asked = np.where(sent < 0, 0.0, np.array(speeds)[np.clip(sent, 0, len(speeds) - 1)])
    travel, velocity = 0.0, 0.0
    for wanted in asked:
        velocity += (wanted - velocity) * fine_s / (lag_ms / 1000.0)
        travel += velocity * fine_s
    assert axis.travel_mm(end_s) == pytest.approx(travel, abs=2e-3)


def test_the_past_does_not_change_with_later_commands():
    axis = LaggingAxis(0.03, 0.02)
    axis.command(0.0, 5.0)
    before = axis.travel_mm(0.02), axis.travel_mm(0.1)
    axis.command(0.08, -5.0)
    assert (axis.travel_mm(0.02), axis.travel_mm(0.1)) == before
    assert axis.travel_mm(0.2) < axis.travel_mm(0.11) + 5.0 * 0.09


def test_the_axis_keeps_within_its_limit():
    axis = LaggingAxis(0.0, 0.01, 3.0)
    axis.command(0.0, 10.0)
    assert axis.travel_mm(2.0) == 3.0


def test_the_spring_shows_stiffness_times_depth_after_a_while():
    spring = ContactSpring(2.0)
    assert spring.advance(np.full(500, 1.5)) == pytest.approx(3.0, abs=1e-9)
    assert spring.force_n == pytest.approx(3.0)


def test_a_gap_never_pulls():
    spring = ContactSpring(2.0)
    depths = np.sin(np.arange(1000) / 20.0)
    shown = [spring.advance(depths[i : i + 1]) for i in range(1000)]
    assert min(shown) >= 0.0
    spring.advance(np.linspace(1.0, -5.0, 3))
    assert spring.force_n == 0.0


def test_looks_may_come_one_by_one_or_all_at_once():
    depths = 1.0 + 0.3 * np.sin(np.arange(64) / 9.0)
    one, all_at_once = ContactSpring(5.0), ContactSpring(5.0)
    for depth in depths:
        one.advance(np.array([depth]))
    all_at_once.advance(depths)
    assert one.shown_n == pytest.approx(all_at_once.shown_n, rel=1e-12)


def test_the_filter_delays_by_one_over_two_pi_its_frequency():
    spring = ContactSpring(1.0, damping_s=0.0, cutoff_hz=30.0)
    rate = 2.0  # mm/s: a ramp comes out late by the time constant
    times = 0.001 * np.arange(1, 2001)
    shown = spring.advance(rate * times)
    late_s = (rate * times[-1] - shown) / rate
    assert late_s == pytest.approx(1.0 / (2.0 * np.pi * 30.0), abs=0.001)


def test_a_spring_without_stiffness_is_refused():
    with pytest.raises(InvalidInputError):
        ContactSpring(0.0)


def test_travels_at_several_times_are_those_at_each():
    axis = LaggingAxis(0.03, 0.05, limit_mm=1.0)
    for step in range(20):
        axis.command(0.1 * step, (-1) ** step * 6.0 + step)
    times = np.linspace(-0.2, 3.0, 200)
    assert axis.travels_mm(times.tolist()) == [axis.travel_mm(float(t)) for t in times]
