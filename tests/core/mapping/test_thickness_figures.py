"""Statistics of thicknesses whose truth nobody knows."""

import numpy as np
import pytest

from rona_core.mapping.thickness_figures import thickness_figures


def test_the_mean_is_over_what_is_not_flagged_and_the_deviation_about_a_plane():
    rng = np.random.default_rng(6)
    positions = rng.uniform(-20, 20, (200, 3))
    positions[:, 2] = 0.01 * positions[:, 0]  # a third coordinate that says nothing new
    thickness = 8.0 + 0.03 * positions[:, 0] - 0.05 * positions[:, 1] + rng.normal(0, 0.02, 200)
    ok = np.ones(200, dtype=bool)
    ok[:20] = False
    thickness[20:30] += 3.0
    figures = thickness_figures(thickness, ok, positions)
    assert figures.mean_mm == pytest.approx(thickness[20:].mean())
    assert figures.robust_sd_mm == pytest.approx(0.02, rel=0.25)
    assert figures.flagged_fraction == pytest.approx(0.1)
    assert figures.failure_fraction == pytest.approx(0.15)
    plain = thickness_figures(thickness, ok, None)
    assert plain.robust_sd_mm > 0.3
    nothing = thickness_figures(thickness, np.zeros(200, dtype=bool), positions)
    assert (nothing.mean_mm, nothing.robust_sd_mm, nothing.failure_fraction) == (None, None, 1.0)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_few_scans_have_figures_too(n):
    figures = thickness_figures(np.full(n, 5.0), np.ones(n, dtype=bool), np.zeros((n, 2)))
    assert (figures.mean_mm, figures.robust_sd_mm, figures.failure_fraction) == (5.0, 0.0, 0.0)
