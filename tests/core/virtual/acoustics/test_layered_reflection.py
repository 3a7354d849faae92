import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.materials import DIPLOE, TABLE, Material
from rona_core.virtual.acoustics.layered_reflection import join, ramp, stack_reflection, step
from tests.helpers.ultrasound_scenes import kwave

F = np.linspace(0.2, 4.5, 120)
WATER = Material(1.5, 1.0)
materials = st.builds(Material, st.floats(1.0, 4.0), st.floats(0.8, 2.5))


@given(two=st.tuples(materials, materials), d=st.floats(0.1, 8.0))
def test_one_layer_is_the_closed_form(two, d):
    layer, behind = two
    z0, z1, z2 = (m.density_g_per_cm3 * m.speed_mm_per_us for m in (WATER, layer, behind))
    tangent = 1j * np.tan(2 * np.pi * F / layer.speed_mm_per_us * d)
    z_in = z1 * (z2 + z1 * tangent) / (z1 + z2 * tangent)
    np.testing.assert_allclose(
        stack_reflection((WATER, layer, behind), (d,), F), (z_in - z0) / (z_in + z0), atol=1e-9
    )


@settings(max_examples=30)
@given(stack=st.lists(st.tuples(materials, st.floats(0.2, 5.0)), min_size=1, max_size=5))
def test_a_lossless_stack_never_reflects_more_than_it_gets(stack):
    layers, depths = [m for m, _ in stack], [d for _, d in stack]
    reflection = stack_reflection((WATER, *layers, WATER), depths, F)
    assert np.abs(reflection).max() <= 1.0 + 1e-12


@settings(max_examples=30)
@given(cut=st.floats(0.05, 0.95), d=st.floats(0.5, 6.0))
def test_cutting_a_layer_in_two_changes_nothing(cut, d):
    whole = stack_reflection((WATER, TABLE, DIPLOE), (d,), F)
    halves = stack_reflection((WATER, TABLE, TABLE, DIPLOE), (cut * d, (1 - cut) * d), F)
    np.testing.assert_allclose(whole, halves, atol=1e-12)


def test_joining_boundaries_is_the_recursion_from_both_sides():
    z = [m.impedance(F) for m in (WATER, TABLE, DIPLOE)]
    delay = np.exp(-2j * TABLE.wavenumber_per_mm(F) * 1.7)
    both = join(step(z[0], z[1]), delay, step(z[1], z[2]))
    np.testing.assert_allclose(
        both.near, stack_reflection((WATER, TABLE, DIPLOE), (1.7,), F), atol=1e-12
    )
    np.testing.assert_allclose(
        both.far, stack_reflection((DIPLOE, TABLE, WATER), (1.7,), F), atol=1e-12
    )


def test_a_vanishing_ramp_is_a_step_and_a_wide_one_is_hardly_seen():
    sharp = ramp(TABLE, DIPLOE, 0.0, F)
    narrow = ramp(TABLE, DIPLOE, 1e-8, F)
    np.testing.assert_allclose(narrow.near, sharp.near, atol=1e-5)
    np.testing.assert_allclose(narrow.through, sharp.through, atol=1e-5)
    wide = ramp(TABLE, DIPLOE, 1.0, F)
    high = F > 2.0
    assert np.abs(wide.near[high]).max() < 0.2 * np.abs(sharp.near[high]).min()


def test_the_numbers_of_layers_must_fit():
    with pytest.raises(InvalidInputError, match="2 thicknesses"):
        stack_reflection((WATER, TABLE, DIPLOE, WATER), (1.0,), F)


def test_four_layers_agree_with_kwave():
    """Full wave equation in 1D, five media: within 1.5 % (the grid itself is good to 1.3 %)."""
    data = kwave("kwave_1d")
    dt, dx = float(data["dt"]) * 1e6, float(data["dx"]) * 1e3
    source_mm, sensor_mm = (int(data["i0"]) + 0.5) * dx, (int(data["i1"]) + 0.5) * dx
    n = 1 << 16
    t, f = np.arange(n) * dt, np.fft.rfftfreq(n, dt)
    sent = np.exp(-((t - 2) ** 2) / (2 * 0.22**2)) * np.cos(2 * np.pi * 2 * (t - 2))
    band = (f > 0.01) & (f < 6.0)
    media = (WATER, Material(2.85, 1.9), Material(2.45, 1.7), Material(2.85, 1.9))
    reflection = stack_reflection((*media, Material(1.56, 1.04)), (2.0, 2.5, 1.5), f[band])
    passed, back = sensor_mm - source_mm, 40.0 - source_mm - sensor_mm
    echo = np.zeros(n // 2 + 1, dtype=complex)
    echo[band] = np.exp(-2j * np.pi * f[band] * passed / 1.5)
    echo[band] += reflection * np.exp(-2j * np.pi * f[band] * back / 1.5)
    model = np.fft.irfft(np.fft.rfft(sent) * echo, n)[: len(data["p"])]
    error = np.linalg.norm(model - data["p"]) / np.linalg.norm(data["p"])
    assert error < 0.015
