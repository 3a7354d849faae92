import numpy as np
import pytest

from rona_core.ultrasound.probe.beam import disc_field, face_rays, mirror_spectrum, probe_beam
from rona_core.ultrasound.probe.excitation import GRID, grid_frequencies_mhz
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import PROBES, probe_model


def test_the_rays_integrate_a_disc():
    points, areas, _ = face_rays(3.0)
    x, y = points.T
    assert areas.sum() == pytest.approx(np.pi * 9, rel=1e-12)
    assert (areas * x**2).sum() == pytest.approx(np.pi * 81 / 4, rel=1e-10)
    assert (areas * x**2 * y**2).sum() == pytest.approx(np.pi * 3**6 / 24, rel=1e-10)
    assert (areas * x).sum() == pytest.approx(0.0, abs=1e-10)


def test_the_field_on_the_axis_is_the_closed_form():
    """A disc of unit pressure: p(z) = exp(-jkz) - z/s exp(-jks), s the way from its rim."""
    f, a, z = np.linspace(0.4, 4.4, 60), 3.175, 15.0
    k = Material(1.6, 0.92).wavenumber_per_mm(f)
    s = np.hypot(a, z)
    exact = np.exp(-1j * k * z) - z / s * np.exp(-1j * k * s)
    np.testing.assert_allclose(disc_field(a, z, np.zeros(1), k)[0], exact, atol=2e-3)


@pytest.mark.parametrize("name", list(PROBES))
def test_a_mirror_on_the_face_echoes_like_the_crystal_sees_its_image(name):
    """Reciprocity: the echo of a mirror is the mean over the crystal of the field at 2 L."""
    probe = probe_model(name)
    f = probe.centre_mhz * np.array((0.75, 1.0, 1.25))
    lossless = Material(probe.line.speed_mm_per_us, probe.line.density_g_per_cm3)
    points, areas, rings = face_rays(probe.aperture_radius_mm)
    radii = np.array([np.hypot(*points[rings == i][0]) for i in range(rings.max() + 1)])
    k = lossless.wavenumber_per_mm(f)
    image = disc_field(probe.aperture_radius_mm, 2 * probe.line_length_mm, radii, k)[rings]
    crystal = np.pi * probe.aperture_radius_mm**2
    mean = (areas[:, None] * image).sum(axis=0) / crystal
    lossy = probe.line.wavenumber_per_mm(f)
    mean *= np.exp(2j * (k - lossy) * probe.line_length_mm)
    undelayed = np.exp(4j * np.pi * f * probe.line_length_mm / probe.line.speed_mm_per_us)
    spectrum = mirror_spectrum(probe)
    grid = grid_frequencies_mhz(probe, GRID)
    seen = np.interp(f, grid, spectrum.real) + 1j * np.interp(f, grid, spectrum.imag)
    np.testing.assert_allclose(seen, mean * undelayed, atol=0.08)


def test_the_same_probe_has_the_same_beam():
    assert probe_beam(probe_model("1MHz")) is probe_beam(probe_model("1MHz"))


@pytest.mark.parametrize("tilt_deg", [0.0, 1.0, 2.0, 3.0])
def test_a_tilted_mirror_echoes_like_the_turned_image_of_the_crystal(tilt_deg):
    """Phase screen on the face, against the field of the disc on its image, by brute force."""
    a, reach, tilt = 3.175, 15.0, np.deg2rad(tilt_deg)
    k = Material(1.6, 0.92).wavenumber_per_mm(np.array((1.8, 2.25, 2.7))).real
    points, areas, rings = face_rays(1.6 * a)
    radii = np.array([np.hypot(*points[rings == i][0]) for i in range(rings.max() + 1)])
    field = disc_field(a, reach, radii, k)[rings]
    gap = points[:, 0] * np.tan(tilt)
    screen = (areas[:, None] * field**2 * np.exp(-2j * np.outer(gap, k))).sum(axis=0)
    disc, shares, _ = face_rays(a)
    x, y = disc.T
    normal = np.array((-np.sin(tilt), 0.0, np.cos(tilt)))
    on_disc = np.column_stack((x, y, np.zeros(len(x))))
    behind = ((0.0, 0.0, reach) - on_disc) @ normal
    image = on_disc + 2.0 * behind[:, None] * normal
    image_k = (shares[:, None] * disc_field_at(a, image, k)).sum(axis=0)
    crystal = np.pi * a**2
    np.testing.assert_allclose(np.abs(screen) / crystal, np.abs(image_k) / crystal, atol=0.06)


def disc_field_at(radius_mm, points, k):
    """Return the field (m, f) of the disc at any points (m, 3)."""
    grid = (np.arange(90) + 0.5) / 45 * radius_mm - radius_mm
    x, y = (c.ravel() for c in np.meshgrid(grid, grid))
    inside = np.hypot(x, y) < radius_mm
    x, y = x[inside], y[inside]
    area = np.pi * radius_mm**2 / inside.sum()
    field = np.zeros((len(points), len(k)), dtype=complex)
    for i, (px, py, pz) in enumerate(points):
        way = np.sqrt((x - px) ** 2 + (y - py) ** 2 + pz**2)
        share = area * pz / (2 * np.pi * way**2)
        for j, kj in enumerate(k):
            field[i, j] = np.sum(share * (1j * kj + 1 / way) * np.exp(-1j * kj * way))
    return field
