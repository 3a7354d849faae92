"""How much of a region a path covers."""

import numpy as np
import pytest

from rona_core.errors import DegenerateGeometryError
from rona_core.path.coverage import REACH_MM, covered_share

RNG = np.random.default_rng(0)
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]


def placed(uv):
    """Return places of a plane (n, 2) as they lie somewhere in space (n, 3)."""
    return np.column_stack((uv, np.zeros(len(uv)))) @ TURN.T + (600.0, 40.0, 380.0)


def disc(radius, n=4000):
    angle, r = RNG.uniform(0, 2 * np.pi, n), radius * np.sqrt(RNG.uniform(0, 1, n))
    return np.column_stack((r * np.cos(angle), r * np.sin(angle)))


def raster(half, spacing):
    rows = np.arange(-half, half + 1e-9, spacing)
    ends = [
        ((-half, v), (half, v)) if i % 2 else ((half, v), (-half, v)) for i, v in enumerate(rows)
    ]
    return np.array([end for pair in ends for end in pair])


SURFACE = placed(disc(25.0))


def test_a_raster_over_the_whole_region_covers_it_and_one_of_half_the_width_less():
    assert covered_share(placed(raster(25.0, 2.5)), SURFACE, 25.0) > 0.99
    # a square of 25 + 5 mm, rounded, in a disc of 25 mm radius
    half = covered_share(placed(raster(12.5, 4.0)), SURFACE, 25.0)
    assert half == pytest.approx((25.0**2 + 4 * 25.0 * REACH_MM) / (np.pi * 25.0**2), abs=0.04)


def test_a_line_covers_its_band_and_nothing_is_covered_beside_the_region():
    line = covered_share(placed(np.array([(-25.0, 0.0), (25.0, 0.0)])), SURFACE, 25.0)
    assert line == pytest.approx(2 * REACH_MM * 50.0 / (np.pi * 25.0**2), abs=0.03)
    assert covered_share(placed(np.array([(60.0, 0.0), (60.0, 9.0)])), SURFACE, 25.0) == 0.0


def test_more_of_a_path_never_covers_less():
    path = placed(raster(25.0, 4.0))
    shares = [covered_share(path[:n], SURFACE, 25.0) for n in range(1, len(path))]
    assert (np.diff(shares) >= 0.0).all()


def test_a_surface_that_is_a_line_is_refused():
    line = np.linspace(0.0, 20.0, 9)[:, None] * (1.0, 2.0, 3.0)
    with pytest.raises(DegenerateGeometryError):
        covered_share(line, line, 25.0)
