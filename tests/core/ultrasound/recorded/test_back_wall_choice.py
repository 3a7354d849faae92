"""Which echo is the back wall: one rule at a time, on echoes made by hand."""

from rona_core.ultrasound.recorded.back_wall_choice import (
    Echo,
    choose_back_wall,
    is_early_and_weak,
)
from rona_core.ultrasound.recorded.band import Band

BAND = Band(2.25, 1.2)


def echo(lengths, level, **changes):
    """Return an echo that many pulse lengths behind the front."""
    return Echo(lengths * BAND.length_us, level, **changes)


def chosen(*echoes, cut=False):
    return choose_back_wall(list(echoes), BAND, cut=cut)


def test_the_first_loud_echo_is_the_back_wall():
    assert chosen(echo(8.0, 0.4)) == 0
    assert chosen(echo(8.0, 0.4), echo(16.0, 0.2)) == 0
    # a floor behind it may be four times as loud; fewer where levels over the front mean little
    assert chosen(echo(12.0, 0.24), echo(14.0, 0.9)) == 0
    assert chosen(echo(12.0, 0.24), echo(14.0, 0.9), cut=True) == 1
    assert chosen(echo(12.0, 0.1), echo(14.0, 0.9)) == 1


def test_without_echoes_there_is_none():
    assert chosen() is None
    assert chosen(echo(8.0, 0.4, foreign=True)) is None


def test_what_comes_by_way_of_the_probe_is_not_it():
    assert chosen(echo(5.0, 0.8, foreign=True), echo(9.0, 0.3)) == 1


def test_a_hole_wanders_and_is_in_fewer_scans_than_a_louder_wall_behind_it():
    wall = echo(12.0, 0.4)
    assert chosen(echo(6.0, 0.3), wall) == 0
    assert chosen(echo(6.0, 0.3, wander_us=0.2), wall) == 1
    assert chosen(echo(6.0, 0.3, share=0.6), wall) == 1
    # a plate over a floor wanders as much as that
    assert chosen(echo(6.0, 0.3, wander_us=0.2), echo(12.0, 0.4, wander_us=0.2)) == 0


def test_an_early_weak_echo_is_a_lobe_if_a_louder_one_is_behind_it():
    assert is_early_and_weak(2.0 * BAND.length_us, 0.2, BAND)
    assert not is_early_and_weak(2.0 * BAND.length_us, 0.3, BAND)
    assert not is_early_and_weak(6.0 * BAND.length_us, 0.1, BAND)
    assert chosen(echo(2.0, 0.15), echo(9.0, 0.3)) == 1
    assert chosen(echo(2.0, 0.15)) == 0
    assert chosen(echo(2.0, 0.05)) is None


def test_lobes_of_a_front_that_was_cut_off_seem_louder():
    assert chosen(echo(2.0, 0.3), echo(9.0, 0.6)) == 0
    assert chosen(echo(2.0, 0.3), echo(9.0, 0.6), cut=True) == 1


def test_a_multiple_at_twice_its_lag_speaks_for_an_early_weak_echo():
    lobe, plate = echo(2.0, 0.15), echo(9.0, 0.3)
    assert chosen(lobe, echo(4.0, 0.05), plate) == 0
    assert chosen(lobe, echo(4.6, 0.05), plate) == 2


def test_a_probe_on_the_plate_hears_multiples_of_one_time_and_nothing_else():
    second = echo(20.0, 0.35, foreign=True, again=True)
    assert chosen(second, echo(40.0, 0.2)) == 0
    # another echo between them: water, and a plate behind it
    assert chosen(echo(14.0, 0.5), second) == 0
    assert chosen(echo(14.0, 0.5), second, echo(28.0, 0.1)) == 0


def test_a_soft_plate_under_the_probe_is_told_by_its_loss():
    assert chosen(echo(20.0, 0.1, foreign=True, again=True, loss_np=0.6)) == 0
    assert chosen(echo(20.0, 0.1, foreign=True, again=True, loss_np=0.1)) is None  # water
    # nothing is known of a level over a front that was cut off, but of the third over the second
    second = echo(20.0, 0.5, foreign=True, again=True)
    assert chosen(second, cut=True) is None
    assert chosen(second, echo(40.0, 0.2, foreign=True, again=True), cut=True) == 0
    assert chosen(second, echo(40.0, 0.05, foreign=True, again=True), cut=True) is None
    soft = echo(40.0, 0.05, foreign=True, again=True, loss_np=0.5)
    assert chosen(second, soft, cut=True) == 0


def test_what_comes_behind_a_multiple_of_the_probe_as_behind_the_front_is_no_other_wall():
    probe = echo(30.0, 0.12, foreign=True, again=True)
    assert chosen(echo(4.0, 0.05), probe, echo(34.0, 0.006)) is None
    assert chosen(echo(12.0, 0.3), probe, echo(42.0, 0.07)) == 0
    assert chosen(echo(4.0, 0.05), probe, echo(38.0, 0.05)) == 2


def test_a_late_echo_that_lost_its_high_frequencies_is_no_lobe():
    floor = echo(20.0, 0.1)
    assert chosen(echo(7.0, 0.05), floor) == 1
    assert chosen(echo(7.0, 0.05, loss_np=1.5), floor) == 0
    assert chosen(echo(2.0, 0.05, loss_np=1.5), floor) == 1  # the front is too near to tell


def test_a_wall_may_wander_more_than_a_lobe_before_it():
    assert chosen(echo(2.0, 0.4), echo(10.0, 0.35, wander_us=0.3), cut=True) == 1


def test_fronts_that_were_cut_off_leave_no_fainter_wall_behind_their_lobes():
    assert chosen(echo(2.0, 0.4), echo(9.0, 0.02), cut=True) is None
    assert chosen(echo(2.0, 0.07), echo(12.0, 0.01)) == 1
