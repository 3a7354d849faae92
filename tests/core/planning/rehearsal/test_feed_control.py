"""Feed by force: slower where the bone is hard, never faster than planned."""

from rona_core.planning.rehearsal.breakthrough import FeedControl
from rona_core.planning.rehearsal.site import ForceReading


def settled(force_at_full_n):
    control = FeedControl()
    for _ in range(200):
        control.update(ForceReading(force_at_full_n * control.share, 0.1))
    return control.share


def test_the_force_settles_at_what_is_wanted():
    assert abs(8.0 * settled(8.0) - 5.0) < 0.2


def test_soft_bone_is_milled_at_the_planned_feed_and_hard_bone_not_at_none():
    assert settled(2.0) == 1.0
    assert settled(100.0) == 0.25
