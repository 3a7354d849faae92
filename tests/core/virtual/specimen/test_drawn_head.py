"""The drawn head is a head for the eye, and never before the surface that is scanned."""

import numpy as np
import pytest
import trimesh

from rona_core.virtual.specimen.simulated.drawn_head import AROUND_REGION_MM, TEMPLATE
from rona_core.virtual.specimen.simulated.simulated_skull import SimulatedSpecimen
from tests.helpers.sphere_world import SphereSpecimen

SEEDS = (300, 347)


@pytest.fixture(scope="module", params=SEEDS)
def skull(request):
    return SimulatedSpecimen(request.param)


@pytest.fixture(scope="module")
def head(skull):
    return skull.drawn_head()


def outside_mm(skull, points):
    """How far (n,) points lie outside the surface in closed form, along rays from its centre."""
    v = points - skull.shape.center_skull
    radius = np.linalg.norm(v, axis=1)
    return radius - skull.shape.radii(v / radius[:, None])[:, 0]


def test_the_calvaria_is_the_true_surface(skull, head):
    assert np.abs(outside_mm(skull, head.calvaria.vertices)).max() < 1e-9


def test_no_part_of_the_face_is_outside_the_true_surface_where_that_is_drawn(skull, head):
    # seen from far above every place of the calvaria, the true surface comes first
    face = trimesh.Trimesh(head.face.vertices, head.face.faces, process=False)
    calvaria = trimesh.Trimesh(head.calvaria.vertices, head.calvaria.faces, process=False)
    center = skull.shape.center_skull
    places = calvaria.triangles_center[::7]
    out = places - center
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    reach = 400.0
    hits = face.ray.intersects_location(places + reach * out, -out, multiple_hits=False)
    depth = reach - np.linalg.norm(hits[0] - (places + reach * out)[hits[1]], axis=1)
    # places of the rim have the free face beside them, up to 2 mm for each mm below the seam
    assert depth.size == 0 or np.quantile(depth, 0.99) < 0.0
    assert depth.max(initial=-1.0) < 0.6


@pytest.mark.parametrize("place", [(None), (70.0, -16.0, -14.0)])  # the mastoid, below the seam
def test_round_the_region_nothing_is_drawn_but_the_true_surface(place):
    center = None
    if place is not None:
        shape = SimulatedSpecimen(300).shape
        u = np.array(place) - shape.center_skull
        u /= np.linalg.norm(u)
        center = shape.center_skull + shape.radii(u[None])[0, 0] * u
    skull = SimulatedSpecimen(300, "right", center, 20.0)
    head, region = skull.drawn_head(), skull.region
    apart = np.linalg.norm(head.face.vertices[head.face.faces] - region.center_skull, axis=2)
    assert (apart.max(axis=1) > region.radius_mm + 5.0).all()
    whole = skull.mesh(3.0).vertices
    near = whole[np.linalg.norm(whole - region.center_skull, axis=1) < region.radius_mm + 8.0]
    drawn = head.calvaria.vertices
    gaps = np.linalg.norm(near[:, None] - drawn, axis=2).min(axis=1)
    assert AROUND_REGION_MM > 8.0
    assert gaps.max() < 1e-9


def test_front_and_sides_can_be_told(head):
    x, y, z = head.face.vertices.T
    assert y.max() > 80.0  # the nose
    assert z.min() < -25.0  # maxilla and mastoids
    nose = head.face.vertices[np.argmax(y)]
    assert abs(nose[0]) < 6.0
    behind = (y < -5.0) & (y > -30.0) & (np.abs(x) > 35.0)
    assert z[behind].min() < -15.0  # both mastoids
    assert {True, False} == set((x[behind & (z < -12.0)] > 0.0).tolist())
    sockets = (y > 50.0) & (np.abs(x) > 15.0) & (np.abs(x) < 45.0)
    assert head.shades[sockets].min() < 0.4 < 0.9 < head.shades.max()  # orbits are in the shade


def test_sutures_lie_on_the_calvaria_and_reach_from_front_to_back(skull, head):
    ends = head.sutures.reshape(-1, 3)
    apart = outside_mm(skull, ends)
    assert 0.2 < apart.min()
    assert apart.max() < 0.4
    assert np.ptp(ends[:, 1]) > 60.0
    assert np.linalg.norm(np.diff(head.sutures, axis=1), axis=2).max() < 6.0


def test_other_specimens_have_none_and_the_template_is_small():
    assert SphereSpecimen().drawn_head() is None
    assert TEMPLATE.stat().st_size <= 100_000
    licence = TEMPLATE.with_name("head_template.LICENSE.txt").read_text()
    assert "Apache License" in licence
