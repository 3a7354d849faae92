"""Solids are what their dimensions say, and what is none of them is refused with its reason."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.planning.implants.solids import (
    Prism,
    Stack,
    cylinder,
    stack_mesh,
    stadium,
)

ROUNDED = Prism(24.0, 20.0, 4.0, -1.0, 4.0)


def volume_mm3(part):
    """Closed form: a rectangle less what its corners lack."""
    r = part.corner_radius_mm
    area = part.length_mm * part.width_mm - (4.0 - np.pi) * r * r
    return area * (part.to_mm - part.from_mm)


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
    mesh = stack_mesh(Stack((part,)), lift_mm=0.5)
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
    mesh = stack_mesh(Stack(parts))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(sum(map(volume_mm3, parts)), rel=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: cylinder(0.72, 0.0, 4.0), "0.72 mm, expected 1 to 120 mm: is it in mm"),
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
