"""Catalogue of implants; every dimension says whether it is sourced or assumed.

Messages, page and REST read ``CATALOGUE``.

Only what lies in the bone is modelled: coil and receiver of a bone-conduction implant lie on it.
"""

from rona_core.errors import NotFoundError
from rona_core.planning.bed import Screw
from rona_core.planning.implants.implant import Dimension, Implant
from rona_core.planning.implants.solids import Stack, cylinder, stadium

MAKER = "maker's page of the Bonebridge BCI 601"
PRENZLER = "Prenzler et al., doi 10.1007/s00405-025-09786-y"
MYLANUS = "study of E. Mylanus: screws of 3 or 4 mm"


def bci_601() -> Implant:
    """Return the transducer of the Bonebridge BCI 601, with a screw on each side."""
    diameter = Dimension("diameter of the transducer", 15.8)
    depth = Dimension("depth of the transducer", 8.7, MAKER)
    return _bone_conduction("BCI 601", diameter, depth)


def bci_602() -> Implant:
    """Return the transducer of the Bonebridge BCI 602, with a screw on each side."""
    diameter = Dimension("diameter of the transducer", 18.2)
    depth = Dimension("depth of the transducer", 4.5, PRENZLER)
    return _bone_conduction("BCI 602", diameter, depth)


def ci_receiver() -> Implant:
    """Return the receiver of a cochlear implant; makers publish no numbers of its bed."""
    length, width = Dimension("length of the bed", 24.0), Dimension("width of the bed", 20.0)
    depth = Dimension("depth of the bed", 4.0)
    part = stadium(length.value_mm, width.value_mm, 0.0, depth.value_mm)
    return Implant("CI receiver", Stack((part,)), (), (length, width, depth))


def osseointegrated_screw() -> Implant:
    """Return the screw of an Osia or Baha, 4 mm long, as the hole that it needs."""
    diameter = Dimension("diameter of the screw", 4.0)
    length = Dimension("length of the screw", 4.0, MYLANUS)
    screw = Screw(0.0, 0.0, length.value_mm, diameter.value_mm)
    hole = cylinder(diameter.value_mm, 0.0, length.value_mm)
    return Implant("Osia/Baha screw", Stack((hole,)), (screw,), (diameter, length))


def _bone_conduction(name: str, diameter: Dimension, depth: Dimension) -> Implant:
    """Return a round transducer with a screw on each side of it, on wings along x."""
    spacing = Dimension("distance between the screws", 24.0)
    length = Dimension("length of the screws", 4.0, PRENZLER)
    thread = Dimension("diameter of the screws", 2.0)
    x_mm = 0.5 * spacing.value_mm
    screws = tuple(Screw(x, 0.0, length.value_mm, thread.value_mm) for x in (-x_mm, x_mm))
    transducer = cylinder(diameter.value_mm, 0.0, depth.value_mm)
    return Implant(name, Stack((transducer,)), screws, (diameter, depth, spacing, length, thread))


CATALOGUE = {
    implant.name: implant
    for implant in (bci_601(), bci_602(), ci_receiver(), osseointegrated_screw())
}


def implant_named(name: str) -> Implant:
    """Return an implant of the catalogue.

    Raises:
        NotFoundError: there is none of that name.
    """
    if name not in CATALOGUE:
        raise NotFoundError(f"no implant {name!r} is known, only {', '.join(CATALOGUE)}")
    return CATALOGUE[name]
