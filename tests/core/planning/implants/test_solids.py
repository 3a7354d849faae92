"""Solids are what their dimensions say, and what is none of them is refused with its reason."""

import numpy as np
import pytest
import trimesh

from rona_core.errors import InvalidInputError
from rona_core.geometry.mesh import Mesh
from rona_core.planning.implants.solids import (
    Prism,
    Stack,
    closed_mesh,
    cylinder,
    load_closed_stl,
    solid_mesh,
    stadium,
)

ROUNDED = Prism(24.0, 20.0, 4.0, -1.0, 4.0)


def volume_mm3(part):
    """Closed form: a rectangle less what its corners lack."""
    r = part.corner_radius_mm
    area = part.length_mm * part.width_mm - (4.0 - np.pi) * r * r
    return area * (part.to_mm - part.from_mm)


def as_mesh(solid):
    return Mesh(np.array(solid.vertices), np.array(solid.faces))


@pytest.mark.parametrize(
    "part",
    [
        cylinder(18.2, 0.0, 4.5),
        stadium(24.0, 20.0, 0.0, 4.0),
        ROUNDED,
        Prism(10.0, 20.0, 5.0, 0.0, 3.0),  # a stadium across
        Prism(12.0, 8.0, 0.0, 0.0, 3.0),
    ],
    ids=lambda part: f"{part.length_mm:g}x{part.width_mm:g}r{part.corner_radius_mm:g}",
)
def test_a_prism_has_its_volume_and_bounds_and_is_closed(part):
    mesh = solid_mesh(Stack((part,)), lift_mm=0.5)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume_mm3(part), rel=1e-3)
    half = 0.5 * np.array((part.length_mm, part.width_mm))
    np.testing.assert_allclose(
        mesh.bounds,
        [(*-half, 0.5 - part.to_mm), (*half, 0.5 - part.from_mm)],
        atol=1e-9,
    )


def test_a_stack_is_the_sum_of_its_parts():
    parts = (cylinder(28.0, -2.0, 1.0), cylinder(16.0, 1.0, 8.7))
    mesh = solid_mesh(Stack(parts))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(sum(map(volume_mm3, parts)), rel=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: cylinder(0.72, 0.0, 4.0), "0.72 mm, expected 1 to 120 mm.*inch by 25.4"),
        (lambda: cylinder(400.0, 0.0, 4.0), "400 mm, expected 1 to 120 mm"),
        (lambda: cylinder(18.0, 4.0, 4.0), "must go down"),
        (lambda: cylinder(18.0, 0.0, 31.0), "to_mm must be"),
        (lambda: Prism(20.0, 10.0, 5.1, 0.0, 4.0), "corner_radius_mm must be 0 to 5"),
        (lambda: stadium(10.0, 20.0, 0.0, 4.0), "at least as long as wide"),
        (lambda: cylinder(float("nan"), 0.0, 4.0), "expected 1 to 120 mm"),
        (lambda: Stack(()), "at least one part"),
        (lambda: Stack((cylinder(9.0, 0.0, 1.0), cylinder(8.0, 2.0, 4.0))), "begin where"),
        (lambda: Stack((cylinder(9.0, 0.0, 0.4),)), "height of a stack is 0.4 mm"),
    ],
)
def test_what_is_no_solid_is_refused(make, words):
    with pytest.raises(InvalidInputError, match=words):
        make()


def test_an_open_mesh_is_refused_with_the_number_of_its_edges():
    ball = trimesh.creation.icosphere(radius=5.0)
    ball.update_faces(np.arange(len(ball.faces)) > 0)
    with pytest.raises(InvalidInputError, match=r"no closed solid: 3 of \d+ edges"):
        closed_mesh(as_mesh(ball), "open.stl")


@pytest.mark.parametrize("scale", [1.0 / 25.4, 25.4, 1e-3])
def test_a_mesh_in_inch_or_metres_is_refused(scale):
    ball = trimesh.creation.icosphere(radius=9.0)
    ball.apply_scale(scale)
    with pytest.raises(InvalidInputError, match=r"inch by 25\.4 and one in metres by 1000"):
        closed_mesh(as_mesh(ball), "ball.stl")


def test_a_mesh_turned_inside_out_is_turned_back_and_one_far_off_is_refused():
    ball = trimesh.creation.icosphere(radius=5.0)
    ball.invert()
    assert solid_mesh(closed_mesh(as_mesh(ball), "ball.stl")).volume > 0.0
    ball.apply_translation((0.0, 0.0, -60.0))
    with pytest.raises(InvalidInputError, match="reaches 65 mm below"):
        closed_mesh(as_mesh(ball), "ball.stl")


def test_a_solid_is_read_from_an_stl_file():
    mesh = solid_mesh(Stack((ROUNDED,)))
    read = load_closed_stl(mesh.export(file_type="stl"), "rounded.STL")
    assert solid_mesh(read).volume == pytest.approx(mesh.volume, rel=1e-6)
    with pytest.raises(InvalidInputError, match="expected an STL file"):
        load_closed_stl(b"", "rounded.obj")
