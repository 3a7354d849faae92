"""What an implant needs of the bone is the shadow of its solid, seen by rays from below."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.planning.implants.implant import CATALOGUE, Implant, implant_named
from rona_core.planning.implants.solids import Prism, Stack, cylinder, stadium

AXIS_MM = np.arange(-15.05, 15.1, 0.7)  # no cell on an edge of the solids


def ray_depths_mm(mesh):
    """Return how deep rays from below meet a mesh, by its triangles alone."""
    x, y = np.meshgrid(AXIS_MM, AXIS_MM, indexing="ij")
    starts = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, -50.0)))
    up = np.tile((0.0, 0.0, 1.0), (len(starts), 1))
    places, rays, _ = mesh.ray.intersects_location(starts, up, multiple_hits=False)
    depth = np.zeros(len(starts))
    depth[rays] = np.maximum(-places[:, 2], 0.0)
    return depth.reshape(x.shape)


STEPPED = Implant(
    "stepped", Stack((Prism(26.0, 18.0, 3.0, -1.0, 1.2), stadium(16.0, 9.0, 1.2, 5.0)))
)
UNDERCUT = Implant("undercut", Stack((cylinder(8.0, 0.0, 2.0), cylinder(20.0, 2.0, 4.0))))


@pytest.mark.parametrize("implant", [*CATALOGUE.values(), STEPPED, UNDERCUT], ids=lambda i: i.name)
@pytest.mark.parametrize("lift_mm", [0.0, 1.5])
def test_depth_is_what_rays_meet(implant, lift_mm):
    lifted = implant.lifted(lift_mm)
    np.testing.assert_allclose(
        lifted.depth_mm(AXIS_MM, AXIS_MM), ray_depths_mm(lifted.mesh()), atol=1e-5
    )


def test_the_outline_is_round_the_widest_part_below_the_surface():
    (ring,) = UNDERCUT.outline()
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 10.0, atol=1e-9)
    np.testing.assert_array_equal(ring[0], ring[-1])
    (ring,) = STEPPED.lifted(2.0).outline()  # the upper part is out of the bone
    assert ring[:, 0].max() == pytest.approx(8.0)


def test_a_lift_takes_so_much_of_the_depth():
    implant = implant_named("BCI 602")
    middle = np.zeros(1)
    for lift_mm in (0.0, 1.0, 4.0):
        assert implant.lifted(lift_mm).depth_mm(middle, middle)[0, 0] == 4.5 - lift_mm
    with pytest.raises(InvalidInputError, match=r"lift_mm must be 0 to 4, not 4\.1"):
        implant.lifted(4.1)
    shallow = Implant("flat", Stack((cylinder(9.0, 0.0, 2.0),)), lift_mm=2.0)
    with pytest.raises(InvalidInputError, match="needs no bed"):
        shallow.outline()


def test_every_dimension_of_the_catalogue_is_marked():
    for implant in CATALOGUE.values():
        known = {dimension.value_mm for dimension in implant.dimensions}
        for part in implant.solid.parts:
            assert {part.length_mm, part.width_mm, part.to_mm} <= known, implant.name
            assert part.from_mm == 0.0
        for screw in implant.screws:
            assert {screw.length_mm, screw.diameter_mm} <= known
    depth = {name: CATALOGUE[name].dimensions[1] for name in ("BCI 601", "BCI 602")}
    assert {name: (d.value_mm, bool(d.source)) for name, d in depth.items()} == {
        "BCI 601": (8.7, True),
        "BCI 602": (4.5, True),
    }
    assert len(CATALOGUE["BCI 602"].screws) == 2


def test_an_implant_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(NotFoundError, match="BCI 601, BCI 602"):
        implant_named("BCI 603")
