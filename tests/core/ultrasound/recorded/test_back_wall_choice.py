"""Which echo is the back wall: one rule at a time, on tracks made by hand."""

import numpy as np
import pytest

from rona_core.ultrasound.recorded.back_wall_choice import (
    SMEARED,
    choose_back_wall,
    is_early_and_weak,
    is_smeared,
    steadiness,
)
from rona_core.ultrasound.recorded.band import Band
from rona_core.ultrasound.recorded.echo_tracks import Track, neighbours
from rona_core.ultrasound.recorded.probe_reverberations import FrontArrivals

BAND = Band(2.25, 1.2)
N = 20
NEAR = neighbours(N, None)
FRONTS = FrontArrivals(np.zeros(N), np.ones(N, dtype=bool), False, BAND, None)


def echo(lengths, level, *, wanders_us=0.0, jumps_us=0.0):
    """Return an echo that many pulse lengths behind the front."""
    smooth = wanders_us * np.sin(np.linspace(0.0, 3.0, N))
    jumps = np.random.default_rng(1).normal(0.0, 1.0, N) * jumps_us
    lag = lengths * BAND.length_us + smooth + jumps
    return Track(lag, np.full(N, level), np.ones(N, dtype=bool))


def chosen(*tracks, foreign=(), again=()):
    no, late = ([k in which for k in range(len(tracks))] for which in (foreign, again))
    return choose_back_wall(list(tracks), no, late, FRONTS, NEAR)


def test_the_first_loud_echo_is_the_back_wall():
    assert chosen(echo(8.0, 0.4)) == 0
    assert chosen(echo(16.0, 0.2), echo(8.0, 0.4)) == 1
    # a floor behind it may be louder, but for five times
    assert chosen(echo(8.0, 0.3), echo(12.0, 0.9)) == 0
    assert chosen(echo(12.0, 0.1), echo(14.0, 0.9)) == 1


def test_without_echoes_there_is_none():
    assert chosen() is None
    assert chosen(echo(8.0, 0.4), foreign=(0,)) is None


def test_what_comes_by_way_of_the_probe_is_not_it():
    assert chosen(echo(5.0, 0.8), echo(9.0, 0.3), foreign=(0,)) == 1


def test_an_early_weak_echo_is_a_lobe_if_it_stands_still_and_a_plate_if_it_wanders():
    assert is_early_and_weak(echo(2.0, 0.2), BAND)
    assert not is_early_and_weak(echo(2.0, 0.3), BAND)
    assert not is_early_and_weak(echo(6.0, 0.1), BAND)
    plate = echo(9.0, 0.3)
    assert chosen(echo(2.0, 0.1), plate) == 1
    assert chosen(echo(2.0, 0.1, wanders_us=0.3), plate) == 0


def test_a_multiple_at_twice_its_lag_speaks_for_an_early_weak_echo():
    lobe, plate, twice = echo(2.0, 0.15), echo(9.0, 0.3), echo(4.0, 0.05)
    assert chosen(lobe, plate, twice) == 0
    assert chosen(lobe, plate, echo(4.6, 0.05)) == 1


def test_a_probe_on_the_plate_hears_multiples_of_one_time_and_nothing_else():
    first, second, third = echo(10.0, 0.6), echo(20.0, 0.35), echo(30.0, 0.2)
    assert chosen(third, first, second, again=(1,)) == 1
    # another echo between them: water, and a plate behind it
    between = echo(14.0, 0.5)
    assert chosen(first, second, between, foreign=(0, 1), again=(0,)) == 2


def test_what_jumps_from_scan_to_scan_is_noise_unless_it_is_loud():
    noise = echo(6.0, 0.15, jumps_us=2.0 * BAND.length_us)
    assert steadiness(noise, NEAR, None, BAND)[0] < 0.5
    assert steadiness(echo(6.0, 0.15), NEAR, None, BAND) == (1.0, False)
    assert steadiness(echo(6.0, 0.15, wanders_us=0.5), NEAR, None, BAND) == (1.0, True)
    assert chosen(noise, echo(9.0, 0.4)) == 1
    assert chosen(noise) == 0


@pytest.mark.parametrize(("lengths", "level"), [(2.5, 0.01), (1.5, 0.03)])
def test_only_what_is_near_and_very_faint_is_left_of_the_front(lengths, level):
    reach, most = SMEARED
    assert is_smeared(echo(0.9 * reach, 0.9 * most), BAND)
    assert not is_smeared(echo(lengths, level), BAND)
