import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.materials import REFERENCE_MHZ, Material
from rona_core.virtual.acoustics.medium import Medium

F = np.linspace(0.3, 4.5, 400)


@given(
    speed=st.floats(0.5, 6.0),
    loss=st.floats(0.0, 20.0),
    power=st.floats(0.8, 1.9),
)
def test_speed_and_loss_are_what_was_asked_for_at_their_reference(speed, loss, power):
    material = Material(speed, 1.9, loss, power)
    at = np.array((1.0, REFERENCE_MHZ))
    k = material.wavenumber_per_mm(at)
    assert 2 * np.pi * REFERENCE_MHZ / k[1].real == pytest.approx(speed, rel=1e-12)
    # 8.686 dB a neper, 10 mm a centimetre
    assert -k[0].imag * 10 * 20 / np.log(10) == pytest.approx(loss, abs=1e-9)


def test_the_exponent_one_is_the_limit_of_its_neighbours():
    limit = Material(2.85, 1.9, 6.0, 1.0).wavenumber_per_mm(F)
    beside = Material(2.85, 1.9, 6.0, 1.0 + 1e-5).wavenumber_per_mm(F)
    np.testing.assert_allclose(limit, beside, rtol=1e-4)


def test_a_lossy_material_answers_only_after_the_cause():
    """The impulse that has crossed 6 mm of bone must not arrive before its fastest part."""
    bone = Material(2.85, 1.9, 9.0, 1.0)
    n, dt = 1 << 14, 0.01
    f = np.fft.rfftfreq(n, dt)
    h = np.zeros(len(f), dtype=complex)
    h[1:] = np.exp(-1j * bone.wavenumber_per_mm(f[1:]) * 12.0)
    h[0] = 1.0
    response = np.fft.irfft(h * np.exp(-((f / 4.0) ** 2)), n)
    t = np.arange(n) * dt
    peak = t[np.argmax(response)]
    before = np.abs(response[t < peak - 0.8]).max()
    after = np.abs(response[(t > peak + 0.8) & (t < peak + 1.6)]).max()
    assert before < 0.01 * response.max()
    assert after > 2.0 * before  # the tail is on the late side


@pytest.mark.parametrize("kwargs", [{"speed_mm_per_us": 0.0}, {"attenuation_db_per_cm": -1.0}])
def test_impossible_materials_are_refused(kwargs):
    good = {"speed_mm_per_us": 2.85, "density_g_per_cm3": 1.9}
    with pytest.raises(InvalidInputError):
        Material(**(good | kwargs))


def test_a_negative_ramp_is_refused():
    with pytest.raises(InvalidInputError, match="ramp"):
        Medium(ramp_mm=-0.1)
