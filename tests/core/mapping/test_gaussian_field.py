import numpy as np
import pytest

from rona_core.mapping.accuracy.map_draws import field_root, stratified_normals

AT = np.arange(0.0, 12.0, 0.5)


def test_a_root_gives_the_covariance_back():
    root = field_root(AT, 2.0)
    expected = np.exp(-0.5 * ((AT[:, None] - AT) / 2.0) ** 2)
    assert root @ root.T == pytest.approx(expected, abs=1e-9)


def test_without_a_reach_every_place_is_by_itself():
    assert np.array_equal(field_root(AT, 0.0), np.eye(len(AT)))


def test_few_stratified_normals_have_the_spread_of_many():
    generator = np.random.default_rng(4)
    found = np.stack([stratified_normals(50, generator) for _ in range(400)])
    plain = generator.standard_normal((400, 50))
    assert abs(found.mean()) < 0.002
    assert found.var() == pytest.approx(1.0, abs=0.02)
    for value in (np.mean, np.std):
        assert value(found, axis=1).std() < 0.3 * value(plain, axis=1).std()
    # in no order, and a single one may be any
    along = np.corrcoef(found[:, :-1].ravel(), found[:, 1:].ravel())[0, 1]
    assert abs(along) < 0.03
    alone = np.concatenate([stratified_normals(1, generator) for _ in range(2000)])
    assert alone.std() == pytest.approx(1.0, abs=0.05)
