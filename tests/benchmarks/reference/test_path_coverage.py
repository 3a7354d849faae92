import numpy as np
import pytest
from hypothesis import given, settings

from benchmarks.reference.path.path_coverage import disc_coverage, length_mm, spacing_mm
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.path.simplification.simplify import simplify
from tests.helpers.paths import demonstration, meander
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=15, deadline=None)
Z = (0.0, 0.0, 1.0)


@given(seed=seeds)
@few
def test_moving_the_path_changes_no_figure(seed):
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    path = meander(600)
    center = np.array((3.0, -2.0, 78.0))
    assert length_mm(T @ path) == pytest.approx(length_mm(path), abs=1e-6)
    assert spacing_mm(T @ path) == pytest.approx(spacing_mm(path), abs=1e-6)
    here = disc_coverage(path, center, Z, 25.0, 3.0)
    there = disc_coverage(T @ path, T @ center, T.rotate(np.array(Z)), 25.0, 3.0)
    assert there == pytest.approx(here, abs=0.01)  # the spiral of cells turns


def test_the_length_of_known_paths():
    angle = np.linspace(0, np.pi, 2001)
    half_circle = 10 * np.column_stack((np.cos(angle), np.sin(angle), 0 * angle))
    assert length_mm(half_circle) == pytest.approx(10 * np.pi, rel=1e-6)
    assert length_mm([[0, 0, 0], [3, 4, 0]]) == pytest.approx(5.0)
    assert length_mm([[1, 1, 1]]) == length_mm(np.zeros((0, 3))) == 0.0


def test_the_spacing_of_a_meander_is_found():
    assert spacing_mm(meander(2000, radius_mm=1e5)) == pytest.approx(5.0, abs=0.05)
    assert spacing_mm(meander(2000, spacing_mm=3.0, radius_mm=1e5)) == pytest.approx(3.0, abs=0.05)
    assert spacing_mm([[0, 0, 0], [100, 0, 0]]) is None


def test_tremor_makes_raw_samples_longer_than_the_simplified_path():
    path, _ = demonstration(np.random.default_rng(0), 3000)
    true_length = length_mm(meander(3000))
    kept = simplify(path, 1.0).index
    assert length_mm(path) > 2.5 * true_length
    assert true_length < length_mm(path[kept]) < 1.3 * true_length  # the hand did wander


def test_a_line_covers_its_stripe_of_the_disc():
    line = [[-40, 0, 0], [40, 0, 0]]
    half = np.arcsin(2.5 / 25)
    stripe = 2 * 25**2 * (half + np.sin(half) * np.cos(half))
    share = disc_coverage(line, (0, 0, 5), Z, 25.0, 5.0)
    assert share == pytest.approx(stripe / (np.pi * 25**2), abs=0.005)
    assert disc_coverage([[0, 0, 0]], (0, 0, 0), Z, 25.0, 50.0) == 1.0
    assert disc_coverage([[90, 0, 0]], (0, 0, 0), (0, 0, -3), 25.0, 5.0) == 0.0


def test_a_meander_as_wide_as_its_spacing_covers_the_disc():
    assert disc_coverage(meander(2000), (0, 0, 80), Z, 20.0, 5.2) == 1.0
    assert disc_coverage(meander(2000), (0, 0, 80), Z, 20.0, 2.5) == pytest.approx(0.5, abs=0.02)


def test_wrong_input_is_refused():
    with pytest.raises(InvalidInputError, match="positive"):
        disc_coverage([[0, 0, 0]], (0, 0, 0), Z, 0.0, 5.0)
    with pytest.raises(DegenerateGeometryError, match="normal"):
        disc_coverage([[0, 0, 0]], (0, 0, 0), (0, 0, 0), 25.0, 5.0)
    with pytest.raises(InvalidInputError, match="apart_mm"):
        spacing_mm([[0, 0, 0], [1, 0, 0]], apart_mm=0.0)
    with pytest.raises(InvalidInputError, match="at least"):
        spacing_mm([[0, 0, 0]])
