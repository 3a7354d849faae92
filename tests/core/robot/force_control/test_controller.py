"""The force loop: on its bench, at its limits, and what it makes of the stiffness."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference.force_loop_bench import run_bench, wave_mm
from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import APPROACH, CONTACT, LOST, STOPPED
from rona_core.errors import InvalidInputError
from rona_core.robot.force_control.controller import (
    ALLOWED_RMS_N,
    ContactController,
    ContactSample,
    StiffnessEstimate,
    contact_gain,
    dead_time_s,
    feed_share,
    speed_limit_mm_per_s,
)

SLOW = ContactSettings()  # 16 ms loop, 32 ms transport
FAST = ContactSettings(period_ms=4.0, delay_ms=8.0, lag_ms=10.0)


def expected_rms_n(stiffness, chosen, speed):
    """RMS force error of the loop over a wave of 2 mm in 60 mm, dead time left out."""
    gain, s = contact_gain(stiffness, chosen), 2j * np.pi * speed / 60.0
    loop = s**2 + stiffness * (gain.proportional * s + gain.integral)
    return abs(stiffness * 2.0 * s**2 / loop) / np.sqrt(2.0)


def test_the_critical_gain_is_pi_over_two_k_t():
    assert dead_time_s(SLOW) == pytest.approx(0.032 + 0.008 + 0.020 + 1.0 / (60.0 * np.pi))
    gain = contact_gain(2.0, SLOW)
    assert gain.critical == pytest.approx(np.pi / (4.0 * dead_time_s(SLOW)))
    assert gain.proportional == pytest.approx(0.3 * gain.critical)


def test_at_the_critical_gain_the_loop_just_rings():
    """Phase of integrator and dead time is half a turn where the amplitude is one."""
    delay_s, k = dead_time_s(SLOW), 2.0
    omega = k * contact_gain(k, SLOW).critical  # |K k / (j w)| = 1
    assert omega * delay_s + np.pi / 2.0 == pytest.approx(np.pi)


@settings(max_examples=40, deadline=None)
@given(stiffness=st.floats(1.0, 100.0), slower=st.booleans())
def test_the_speed_limit_is_where_the_expected_error_is_what_is_allowed(stiffness, slower):
    chosen = SLOW if slower else FAST
    speed = speed_limit_mm_per_s(stiffness, chosen)
    assert expected_rms_n(stiffness, chosen, speed) == pytest.approx(ALLOWED_RMS_N, rel=1e-9)
    assert speed_limit_mm_per_s(1.5 * stiffness, chosen) < speed
    assert feed_share(stiffness, chosen, 0.5 * speed) == 1.0
    assert feed_share(stiffness, chosen, 2.0 * speed) == pytest.approx(0.5)


def test_a_contact_too_soft_to_err_that_much_is_never_slowed():
    assert feed_share(0.2, SLOW, 100.0) == 1.0


def test_two_newton_a_millimetre_at_full_speed_keeps_the_force():
    run = run_bench(SLOW, offset_mm=wave_mm(2.0, 60.0), stiffness_n_per_mm=2.0)
    assert not run.reason
    assert run.n_losses == 0
    assert run.rms_n <= 0.7
    assert run.peak_n <= 6.0
    assert run.feed_share[run.way_mm > 40.0].min() > 0.95  # it is not bought with speed
    assert run.stiffness_n_per_mm == pytest.approx(2.0, rel=0.25)


@pytest.mark.parametrize(("stiffness", "times"), [(5.0, 1.2), (20.0, 2.0)])
def test_a_stiff_contact_slows_the_scan_instead_of_ringing(stiffness, times):
    quick = 180.0 / 20.0
    run = run_bench(SLOW, offset_mm=wave_mm(), stiffness_n_per_mm=stiffness)
    free = run_bench(SLOW, offset_mm=wave_mm(), stiffness_n_per_mm=stiffness, limit_feed=False)
    assert not run.reason
    assert run.rms_n <= 1.0
    assert run.peak_n <= 6.0
    assert run.duration_s > times * quick
    assert run.rms_n < 0.6 * free.rms_n
    assert run.stiffness_n_per_mm == pytest.approx(stiffness, rel=0.15)


def test_a_faster_loop_keeps_the_force_better():
    slow = run_bench(SLOW, offset_mm=wave_mm())
    fast = run_bench(FAST, offset_mm=wave_mm())
    assert fast.rms_n < 0.25 * slow.rms_n


def test_a_contact_that_grows_stiffer_on_the_way_is_noticed():
    def stiffness(way_mm):
        return 2.0 + min(max(way_mm - 60.0, 0.0), 40.0) * 0.45  # to 20 N/mm

    run = run_bench(SLOW, offset_mm=wave_mm(1.0), stiffness_n_per_mm=stiffness, length_mm=240.0)
    assert not run.reason
    assert run.stiffness_n_per_mm > 6.0
    assert run.peak_n < SLOW.stop_n
    assert run.n_losses == 0
    assert run.feed_share[run.way_mm > 150.0].max() < 0.7


def test_a_surface_that_drops_away_stops_the_robot_and_it_says_so():
    run = run_bench(SLOW, offset_mm=lambda way: 0.0 if way < 60.0 else 20.0)
    assert "contact was lost" in run.reason
    assert run.states[-1] == STOPPED
    assert LOST in run.states
    assert 60.0 < run.way_mm[-1] < 70.0
    assert run.travel_mm.max() <= SLOW.travel_mm + 1e-9
    assert run.feed_share[-1] == 0.0


def test_a_step_within_reach_is_found_again():
    run = run_bench(SLOW, offset_mm=lambda way: 0.0 if way < 60.0 else 2.5, length_mm=120.0)
    assert not run.reason
    assert run.n_losses == 1
    assert run.way_mm[-1] >= 120.0
    assert run.force_n[-1] == pytest.approx(3.0, abs=0.3)


def test_no_surface_within_the_travel_stops_before_the_scan():
    run = run_bench(SLOW, offset_mm=lambda way: 8.0)
    assert "no surface was met" in run.reason
    assert run.way_mm[-1] == 0.0


def test_a_wall_stops_the_robot_by_its_force():
    run = run_bench(
        SLOW, offset_mm=lambda way: 0.0 if way < 60.0 else -6.0, stiffness_n_per_mm=10.0
    )
    assert "20 N stop" in run.reason
    assert run.states[-1] == STOPPED


def test_the_same_samples_give_the_same_commands():
    first, second = (run_bench(SLOW, offset_mm=wave_mm(), seed=5) for _ in range(2))
    other = run_bench(SLOW, offset_mm=wave_mm(), seed=6)
    np.testing.assert_array_equal(first.force_n, second.force_n)
    assert not np.array_equal(first.force_n, other.force_n)


def pressed_on(force_n=3.0, travel_mm=1.0):
    """A controller that has been in contact for a while, and the time of its next sample."""
    controller = ContactController(SLOW)
    for i in range(100):
        command = controller.step(ContactSample(0.016 * i, force_n, travel_mm))
    assert command.state == CONTACT
    assert command.ready
    return controller, 1.6


def test_a_silent_sensor_stops_the_robot():
    controller, now_s = pressed_on()
    command = controller.step(ContactSample(now_s + 0.5, 3.0, 1.0))
    assert command.state == STOPPED
    assert "silent" in command.reason
    stuck, now_s = pressed_on()
    stuck.step(ContactSample(now_s, 3.0, 1.0))
    assert stuck.step(ContactSample(now_s, 3.0, 1.0)).state == STOPPED


def test_a_saturated_sensor_stops_the_robot():
    controller, now_s = pressed_on()
    command = controller.step(ContactSample(now_s, 3.0, 1.0, saturated=True))
    assert "end of its range" in command.reason


def test_a_force_above_the_monitored_one_halts_then_stops():
    controller, now_s = pressed_on()
    commands = [controller.step(ContactSample(now_s + 0.016 * i, 12.0, 1.0)) for i in range(40)]
    assert commands[0].state == CONTACT
    assert commands[0].velocity_mm_per_s < 0.0
    assert commands[-1].state == STOPPED
    assert "stayed above 10 N" in commands[-1].reason
    assert commands[-1].feed_share == 0.0


def test_the_first_reason_stays():
    controller, _ = pressed_on()
    controller.stop("somebody pressed Stop")
    controller.stop("another reason")
    assert controller.step(ContactSample(1.6, 30.0, 1.0)).reason == "somebody pressed Stop"


@settings(max_examples=60, deadline=None)
@given(
    forces=st.lists(st.floats(-5.0, 25.0), min_size=5, max_size=60),
    travel_mm=st.floats(-6.0, 6.0),
)
def test_no_command_leads_out_of_the_band_or_beyond_the_certified_speed(forces, travel_mm):
    controller = ContactController(SLOW, travel_mm=4.0)
    for i, force_n in enumerate(forces):
        command = controller.step(ContactSample(0.016 * i, force_n, travel_mm, 0.0, 20.0))
        after = travel_mm + command.velocity_mm_per_s * SLOW.period_s
        assert abs(after) <= max(4.0, abs(travel_mm)) + 1e-9 or command.state == STOPPED
        assert 0.0 <= command.feed_share <= 1.0


def test_the_integrator_does_not_wind_up_against_the_end_of_the_travel():
    controller, now_s = pressed_on(travel_mm=4.0, force_n=3.0)
    for i in range(14):  # at the end of the travel, with less force than wanted
        controller.step(ContactSample(now_s + 0.016 * i, 2.0, 5.0))
    command = controller.step(ContactSample(now_s + 0.016 * 14, 3.5, 5.0))
    assert command.velocity_mm_per_s < 0.0


def test_the_approach_closes_at_its_speed_whatever_the_motion_does():
    controller = ContactController(SLOW)
    for i in range(60):
        closing = 15.0 if i < 30 else 0.0
        command = controller.step(ContactSample(0.016 * i, 0.0, 0.0, closing))
    assert command.state == APPROACH
    assert command.velocity_mm_per_s == pytest.approx(2.0)
    assert not command.ready


def test_the_slope_of_the_touch_down_is_the_stiffness():
    estimate = StiffnessEstimate(2.0, 0.016)
    for i in range(20):
        estimate.touching(0.03 * i, 0.3 + 7.0 * 0.03 * i)
    assert estimate.n_per_mm == pytest.approx(7.0)


def test_following_a_surface_says_nothing_of_the_spring():
    estimate = StiffnessEstimate(2.0, 0.016)
    times = 0.016 * np.arange(1000)
    for t in times:  # travel follows a wave; the force is a quarter of a period ahead
        estimate.watching(2.0 * np.sin(2.0 * t), 3.0 - 1.0 * np.cos(2.0 * t))
    assert estimate.n_per_mm == 2.0


def test_ringing_tells_the_stiffness():
    estimate = StiffnessEstimate(2.0, 0.016)
    for t in 0.016 * np.arange(200):
        ringing = 0.1 * np.sin(2.0 * np.pi * 4.0 * t)
        estimate.watching(ringing, 3.0 + 12.0 * ringing)
    assert estimate.n_per_mm == pytest.approx(12.0, rel=0.01)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("force_n", 0.1),
        ("period_ms", 0.0),
        ("delay_ms", -1.0),
        ("travel_mm", 20.0),
        ("monitor_n", 3.5),
        ("stop_n", 9.0),
        ("approach_mm_per_s", float("nan")),
    ],
)
def test_settings_out_of_range_are_refused_by_name(name, bad):
    with pytest.raises(InvalidInputError, match=name):
        replace(SLOW, **{name: bad})
