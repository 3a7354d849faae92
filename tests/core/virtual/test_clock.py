import threading

import pytest

from rona_core.errors import InvalidInputError
from rona_core.virtual.clock import MAX_LAG_S, CaptureClock


class Wall:
    """Real time that passes 10 ms at every look, so that paced waits end without waiting."""

    def __init__(self, step_s=0.01):
        self.time_s, self.step_s, self.looks = 100.0, step_s, 0

    def __call__(self):
        self.looks += 1
        self.time_s += self.step_s
        return self.time_s


def test_waiting_at_once_jumps_and_never_goes_back():
    clock = CaptureClock()
    clock.wait_until(12.5)
    assert clock.now() == 12.5
    clock.wait_until(3.0)
    assert clock.now() == 12.5
    clock.reset()
    assert clock.now() == 0.0


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_a_paced_wait_ends_exactly_at_its_time_after_that_much_real_time(speed):
    wall = Wall()
    clock = CaptureClock(speed, wall=wall)
    began = wall.time_s
    clock.wait_until(0.2)
    assert clock.now() == 0.2
    assert wall.time_s - began >= 0.2 / speed
    assert wall.time_s - began <= 0.2 / speed + 2 * wall.step_s


def test_the_clock_stands_still_while_nobody_waits():
    wall = Wall()
    clock = CaptureClock(1.0, wall=wall)
    clock.wait_until(0.05)
    wall.time_s += 10.0
    assert clock.now() == 0.05


def test_a_long_pause_is_not_caught_up_in_a_rush():
    wall = Wall()
    clock = CaptureClock(1.0, wall=wall)
    wall.time_s += 4 * MAX_LAG_S
    before = wall.looks
    clock.wait_until(0.1)
    assert wall.looks - before >= 10  # ten looks of 10 ms each, not one jump


def test_a_small_delay_is_caught_up():
    wall = Wall()
    clock = CaptureClock(1.0, wall=wall)
    wall.time_s += 0.1
    before = wall.looks
    clock.wait_until(0.1)
    assert wall.looks - before == 1


@pytest.mark.parametrize("action", ["interrupt", "reset"])
def test_a_wait_can_be_ended_from_another_thread(action):
    clock = CaptureClock(1e-3)
    started = threading.Event()

    def wait():
        started.set()
        clock.wait_until(100.0)

    waiter = threading.Thread(target=wait)
    waiter.start()
    started.wait()
    while waiter.is_alive():  # the waiter may not have begun to wait yet
        getattr(clock, action)()
        waiter.join(0.01)
    assert clock.now() < 1.0


def test_a_new_speed_reaches_a_wait_that_is_under_way():
    clock = CaptureClock(1e-6)
    waiter = threading.Thread(target=clock.wait_until, args=(5.0,))
    waiter.start()
    clock.speed = None
    waiter.join(10.0)
    assert not waiter.is_alive()
    assert clock.now() == 5.0


def test_many_threads_end_at_the_latest_time():
    clock = CaptureClock()
    threads = [threading.Thread(target=clock.wait_until, args=(float(t),)) for t in range(1, 20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert clock.now() == 19.0


@pytest.mark.parametrize("time_s", [float("nan"), float("inf")])
def test_a_time_that_never_comes_is_refused(time_s):
    with pytest.raises(InvalidInputError, match="time_s"):
        CaptureClock().wait_until(time_s)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_speed_that_never_arrives_is_refused(speed):
    with pytest.raises(InvalidInputError, match="speed"):
        CaptureClock(speed)
