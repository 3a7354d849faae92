import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.errors import DeviceError, InvalidInputError
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.surface import raycast
from rona_core.geometry.surface.raycast import MeshRaycaster


def sphere():
    solid = trimesh.creation.icosphere(3, 50.0)
    return Mesh(np.array(solid.vertices), np.array(solid.faces))


def rays(rng, n):
    o = rng.normal(size=(n, 3))
    o *= 120.0 / np.linalg.norm(o, axis=1, keepdims=True)
    d = rng.uniform(-60.0, 60.0, (n, 3)) - o
    return o, d / np.linalg.norm(d, axis=1, keepdims=True)


def brute_force(mesh, o, d):
    """Moeller and Trumbore over all triangles."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    best = np.full(len(o), np.inf)
    for i in range(len(o)):
        p = np.cross(d[i], c - a)
        det = np.einsum("ij,ij->i", b - a, p)
        s = o[i] - a
        u = np.einsum("ij,ij->i", s, p) / det
        q = np.cross(s, b - a)
        v = q @ d[i] / det
        t = np.einsum("ij,ij->i", c - a, q) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        best[i] = t[hit].min(initial=np.inf)
    return best


def test_first_hits_agree_with_brute_force():
    o, d = rays(np.random.default_rng(0), 150)
    found, expected = MeshRaycaster(sphere()).first_hit(o, d), brute_force(sphere(), o, d)
    assert np.isinf(expected).any()
    assert np.isfinite(expected).sum() > 50
    np.testing.assert_allclose(found, expected, atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_moving_mesh_and_rays_keeps_the_distances(seed):
    rng = np.random.default_rng(seed)
    mesh, turn, shift = sphere(), Rotation.random(rng=rng).as_matrix(), rng.uniform(-300, 300, 3)
    o, d = rays(rng, 30)
    moved = MeshRaycaster(Mesh(mesh.vertices @ turn.T + shift, mesh.faces))
    distances = MeshRaycaster(mesh).first_hit(o, d)
    finite = np.isfinite(distances)
    again = moved.first_hit(o @ turn.T + shift, d @ turn.T)
    both = finite & np.isfinite(again)
    assert (finite != np.isfinite(again)).sum() <= 1  # single precision at the silhouette
    np.testing.assert_allclose(again[both], distances[both], atol=1e-3)


def test_no_rays_give_no_distances():
    assert MeshRaycaster(sphere()).first_hit(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_bad_input_is_refused_by_name():
    caster = MeshRaycaster(sphere())
    with pytest.raises(InvalidInputError, match="as many directions"):
        caster.first_hit(np.zeros((2, 3)), np.eye(3)[:1])
    with pytest.raises(InvalidInputError, match="unit vector"):
        caster.first_hit(np.zeros((1, 3)), [[0.0, 0.0, 2.0]])
    with pytest.raises(InvalidInputError, match="needs triangles"):
        MeshRaycaster(Mesh(np.eye(3), np.zeros((0, 3), dtype=np.int64)))
    with pytest.raises(InvalidInputError, match="faces name vertices"):
        MeshRaycaster(Mesh(np.eye(3), np.array([[0, 1, 3]])))


def test_without_embree_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(raycast.trimesh.ray, "has_embree", False)
    with pytest.raises(DeviceError, match="embreex"):
        MeshRaycaster(sphere())
