from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import hilbert

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.materials import BRAIN, DIPLOE, TABLE
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, probe_model
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import LayerProfile
from rona_core.virtual.acoustics.layered_reflection import stack_reflection
from rona_core.virtual.acoustics.medium import Medium

PROBE = probe_model("2.25MHz")
QUIET = Medium(ramp_mm=0.0, outer_roughness_mm=0.0, inner_roughness_mm=0.0, speckle=0.0)


def flat(model, *, outer=0.0, table=1.8, diploe=2.4, inner=1.8, tilt_rad=0.0):
    xy = model.ray_points_mm
    ones = np.ones(len(xy))
    gap = outer + xy[:, 0] * np.tan(tilt_rad)
    entries = np.column_stack((xy, gap))
    return LayerProfile(gap, table * ones, diploe * ones, inner * ones, ones > 0, entries)


def envelope(trace):
    return np.abs(hilbert(trace))


def test_perfect_contact_uses_the_stated_share_of_the_converter():
    for excitation in ("pulse", "chirp"):
        model = EchoModel(PROBE, excitation, QUIET, 0)
        assert np.abs(model.perfect_front()).max() == pytest.approx(FULL_SCALE_SHARE)


@pytest.mark.parametrize(("exact", "off"), [(True, 1e-12), (False, 3e-7)])
def test_a_flat_bone_echoes_as_its_layers_do_on_a_perfect_mirror(exact, off):
    """All rays alike, no spreading: the mirror's echo times the reflection of the whole stack."""
    model = EchoModel(PROBE, "pulse", QUIET, 0, exact=exact)
    model._stack._spreading = None
    f = model._beam.frequencies_mhz
    stack = (PROBE.line, QUIET.gel, TABLE, DIPLOE, TABLE, BRAIN)
    reflection = stack_reflection(stack, (PROBE.film_mm, 1.8, 2.4, 1.8), f)
    shortened = np.exp(2j * PROBE.line.wavenumber_per_mm(f) * PROBE.film_mm)
    whole = model._record(model._beam.weights.sum(axis=0) * shortened * reflection)
    np.testing.assert_allclose(model.trace(flat(model)), whole, atol=off)


def test_the_gain_is_the_receivers_and_not_the_bones():
    """Harder bone is louder: 0.57 of the sound comes back from nominal bone, 0.66 from this."""
    dense = replace(QUIET, table=replace(TABLE, density_g_per_cm3=2.6))
    nominal, loud = (EchoModel(PROBE, "pulse", m, 0).perfect_front() for m in (QUIET, dense))
    shares = []
    for table in (QUIET.table, dense.table):
        bone, gel = (m.density_g_per_cm3 * m.speed_mm_per_us for m in (table, QUIET.gel))
        shares.append((bone - gel) / (bone + gel))
    measured = np.abs(loud).max() / np.abs(nominal).max()
    assert measured == pytest.approx(shares[1] / shares[0], rel=0.02)


@settings(max_examples=15, deadline=None)
@given(outer=st.floats(0.2, 1.4), further=st.floats(0.1, 0.6))
def test_a_wider_gap_of_gel_only_delays_the_front(outer, further):
    model = EchoModel(PROBE, "pulse", QUIET, 0)
    near, far = (model.trace(flat(model, outer=d)) for d in (outer, outer + further))
    t = np.arange(len(near)) / PROBE.sampling_mhz
    delay = np.argmax(np.correlate(far, near, "full")) - (len(near) - 1)
    assert delay / PROBE.sampling_mhz == pytest.approx(2 * further / 1.5, abs=0.025)
    assert t[np.argmax(far)] > t[np.argmax(near)]


def test_a_pressed_line_brings_the_front_forward_at_its_own_speed():
    model = EchoModel(PROBE, "pulse", QUIET, 0)
    rest, pressed = (model.trace(flat(model, outer=d)) for d in (0.0, -1.0))
    advance = (len(rest) - 1) - np.argmax(np.correlate(pressed, rest, "full"))
    assert advance / PROBE.sampling_mhz == pytest.approx(2 * 1.0 / 1.6, abs=0.03)


def test_the_inner_echo_comes_after_the_bone_with_the_opposite_sign():
    silent_behind = replace(QUIET, brain=TABLE)  # no inner boundary
    traces = [
        EchoModel(PROBE, "pulse", medium, 0).trace(flat(EchoModel(PROBE, "pulse", medium, 0)))
        for medium in (QUIET, silent_behind)
    ]
    inner = traces[0] - traces[1]
    front = EchoModel(PROBE, "pulse", QUIET, 0).perfect_front()
    lag = np.argmax(envelope(inner)) - np.argmax(envelope(front))
    nominal = 2 * (3.6 / 2.85 + 2.4 / 2.45)
    early = nominal - lag / PROBE.sampling_mhz  # dispersion speeds the envelope up
    assert 0.0 < early < 0.3
    correlation = np.correlate(inner, front, "full")
    assert abs(correlation.min()) > correlation.max()
    level = 20 * np.log10(envelope(inner).max() / envelope(front).max())
    assert -32 < level < -20


def test_tilt_costs_a_third_of_the_front_at_two_degrees_and_more_beyond():
    """The size itself is held against an image source in the tests of the beam."""
    model = EchoModel(PROBE, "chirp", QUIET, 0)
    peaks = [
        envelope(model.trace(flat(model, outer=1.0, tilt_rad=np.deg2rad(a)))).max()
        for a in (0.0, 1.0, 2.0, 3.0, 5.0)
    ]
    loss_db = 20 * np.log10(np.array(peaks) / peaks[0])
    assert np.all(np.diff(loss_db) < 0)
    assert -1.6 < loss_db[1] < -0.4
    assert -9.0 < loss_db[3] < -4.5


def test_a_graded_diploe_is_quieter_than_a_sharp_one():
    level = {}
    for width in (0.0, 0.8):
        medium = replace(QUIET, ramp_mm=width, brain=TABLE)
        model = EchoModel(PROBE, "pulse", medium, 0)
        bare = replace(medium, diploe=TABLE)
        echo = model.trace(flat(model)) - EchoModel(PROBE, "pulse", bare, 0).trace(flat(model))
        level[width] = envelope(echo).max()
    assert level[0.8] < 0.5 * level[0.0]


def test_speckle_is_frozen_in_the_skull():
    medium = replace(QUIET, speckle=0.03)
    model = EchoModel(PROBE, "pulse", medium, 7)
    first, again = model.trace(flat(model)), model.trace(flat(model))
    np.testing.assert_array_equal(first, again)
    other = EchoModel(PROBE, "pulse", medium, 8).trace(flat(model))
    assert np.abs(first - other).max() > 1e-4


def test_air_before_the_face_mirrors_with_the_opposite_sign():
    model = EchoModel(PROBE, "pulse", QUIET, 0)
    contact, air = model.perfect_front(), model.lifted()
    correlation = np.correlate(air, contact, "full")
    assert -correlation.min() > correlation.max()


def test_rays_that_miss_the_bone_return_nothing():
    model = EchoModel(PROBE, "pulse", QUIET, 0)
    profile = flat(model)
    none = replace(profile, hit=np.zeros(len(profile.hit), dtype=bool))
    assert envelope(model.trace(none)).max() < 0.05 * envelope(model.trace(profile)).max()


def test_a_profile_for_another_beam_is_refused():
    model = EchoModel(PROBE, "pulse", QUIET, 0)
    profile = flat(model)
    short = replace(profile, outer_mm=profile.outer_mm[:-1])
    with pytest.raises(InvalidInputError, match="rays"):
        model.trace(short)
