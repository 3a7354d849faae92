"""Why a file of bone is refused: cause, words and remedy, each in one place.

The page of loaded skulls lists the causes, and a test has a file for each, applies its remedy and
loads it.
"""

from dataclasses import dataclass

from rona_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Refusal:
    """What is said of one cause; the values in braces are filled in where it is found."""

    words: str  # what was expected and what came
    remedy: str  # what makes the file load


REFUSALS: dict[str, Refusal] = {
    "voxels in another file": Refusal(
        "{name} says that its voxels lie in another file, which is not opened: expected header "
        "and voxels in one file",
        "export it again with the data attached (.nrrd, or one .nii or .nii.gz)",
    ),
    "no single volume": Refusal(
        "{name} must be one volume of at least 8 voxels a side, not {shape}",
        "export one scalar volume: three dimensions, one value a voxel",
    ),
    "too many voxels": Refusal(
        "{name} has {shape} voxels: at most {most:.0f} million are read",
        "crop it to the head, or resample it",
    ),
    "no space": Refusal(
        "{name} does not say which way its coordinates run, so that a mirrored head would look "
        "like a right one",
        "state its space in the header, as 'space: left-posterior-superior' or another one",
    ),
    "an unknown space": Refusal(
        "{name} is in the space {space!r}: expected three of left or right, anterior or "
        "posterior, inferior or superior (or their letters, as LPS), scanner-xyz, "
        "3D-right-handed or 3D-left-handed",
        "correct 'space' in the header",
    ),
    "no directions": Refusal(
        "{name} does not say how large its voxels are, or which way one of its axes runs",
        "export it again with three finite space directions, in mm",
    ),
    "another unit": Refusal(
        "{name} is in units of {unit}: expected millimetres",
        "multiply its voxel sizes and its origin by {factor:g}, and state mm",
    ),
    "voxels too small": Refusal(
        "{name} has voxels of {edges} mm: expected {low:g} to {high:g} mm",
        "if its lengths are in another unit, as metres, write them in mm",
    ),
    "slices too thick": Refusal(
        "{name} has voxels of {edges} mm: slices too thick, at most {high:g} mm are read, as "
        "thicker ones do not show a bone of a few millimetres",
        "take a reconstruction with thinner slices (1 mm or less); interpolating these brings "
        "nothing back",
    ),
    "a skewed grid": Refusal(
        "the grid of {name} is skewed, its axes are {angle_deg:.1f} degrees off right angles (a "
        "tilted gantry leaves such)",
        "resample it to right angles",
    ),
    "values that are not finite": Refusal(
        "{name} holds values that are not finite",
        "replace them, by air where nothing was measured",
    ),
    "one value only": Refusal(
        "{name} holds only the value {low:g}: expected bone and air in one volume",
        "export the mask that has both",
    ),
    "grey values without a threshold": Refusal(
        "{name} holds grey values from {low:g} to {high:g}, so it is no mask",
        "give the threshold from which a value is bone (for a CT about 300)",
    ),
    "labels without a label": Refusal(
        "{name} is a map of the labels {labels}",
        "say which of them is bone (--label N, 'label', or the field Bone label)",
    ),
    "a label that it does not hold": Refusal(
        "{name} has no voxel of label {label:g}: its values are {labels}",
        "name one of those",
    ),
    "a threshold beyond its values": Refusal(
        "{name} has values from {low:g} to {high:g}, and no voxel or every one reaches the "
        "threshold of {threshold:g}",
        "choose a threshold between them, in the units of the file",
    ),
    "too little bone": Refusal(
        "{name} has {bone_cm3:.1f} cm3 of bone: expected a skull or a part of one, of at least "
        "{least_cm3:g} cm3",
        "lower the threshold, or name the file and the label that hold the bone",
    ),
    "too much bone": Refusal(
        "{share:.0%} of {name} is bone: expected a skull surrounded by air",
        "swap bone and air if they are inverted, or raise the threshold",
    ),
    "two grids": Refusal(
        "the outer grid is {outer}, the inner {inner}, or they lie elsewhere",
        "export both on one grid",
    ),
    "an inner volume outside the outer one": Refusal(
        "{outside:.0%} of the inner volume lies outside the outer one, up to {depth_mm:.1f} mm, "
        "farthest at {place}",
        "give the filled head first and the filled cavity as inner file",
    ),
    "an open mesh": Refusal(
        "{name} is not closed: {odd} of {count} edges have one triangle, or another odd number",
        "close its holes, or export the mask as a volume instead",
    ),
    "a mesh of another size": Refusal(
        "{name} measures {extent}: expected a skull of {low:g} to {high:g} mm{hint}",
        "write its coordinates in mm",
    ),
    "surfaces that cross themselves": Refusal(
        "{odd} of {count} lines cross the mesh an odd number of times: its surfaces intersect or "
        "have holes",
        "repair it, or export the mask as a volume instead",
    ),
    "an inner surface outside the outer one": Refusal(
        "the inner surface lies outside the outer one",
        "give the outer file first and the inner one second, both in the same coordinates",
    ),
    "an inner surface that crosses the outer one": Refusal(
        "the inner surface crosses the outer one: {count} of {places} corners and middles of "
        "triangles lie on the wrong side, the farthest by {depth_mm:.1f} mm at {place}",
        "pull it in there, or take both surfaces from one segmentation",
    ),
    "too many triangles": Refusal(
        "the mesh has {count} triangles near the disc, too many or too large: cut to {edge:g} mm "
        "they would be {millions:.0f} million, {most:.0f} are allowed",
        "reduce the mesh, or remove surfaces that are not bone",
    ),
    "a threshold for a mesh": Refusal(
        "a mesh has no grey values and no labels",
        "leave threshold and label out",
    ),
    "threshold and label at once": Refusal(
        "a threshold of {threshold:g} and the label {label:g} were given: one of them says what is "
        "bone",
        "leave the other out",
    ),
    "files of different kinds": Refusal(
        "cannot load {names}: expected a volume ({volumes}) or a mesh ({meshes}), both files alike",
        "export the bone as one of these",
    ),
    "a centre off the bone": Refusal(
        "the centre {center} must lie on the outer surface, but it is {nearest:.1f} mm from the "
        "nearest bone, and {off:.1f} mm from the surface on the line from the middle of the head",
        "choose a point within {within:g} mm of the surface",
    ),
    "a centre in the middle of the head": Refusal(
        "the centre {center} lies in the middle of the head", "choose one on the bone"
    ),
    "no whole patch": Refusal(
        "no whole patch of bone of radius {radius_mm:g} mm was found on either side of the skull",
        "choose a smaller radius, or give the centre of the region",
    ),
    "a disc where the head was held": Refusal(
        "the disc about {center} reaches to where the head was held, {off:.0f} mm from its centre",
        "choose a centre farther from that, or take the holder out of the file",
    ),
    "holes in the disc": Refusal(
        "only {share:.0%} of the disc about {center} is bone: {missing:.0%} of it is hole or edge",
        "choose another centre or a smaller radius",
    ),
    "bone without an inner surface": Refusal(
        "{share:.0%} of the disc about {center} has no inner surface within {depth:g} mm: the head "
        "seems to be filled",
        "give the filled cavity as inner file, or the bone alone",
    ),
    "a drawn surface off the bone": Refusal(
        "{name}: its drawn surface, which the robot keeps clear of, would be {worst:.1f} mm off "
        "its bone at {place}; at most {most:g} mm are allowed",
        "resample the file to voxels of about 1 mm, or choose another centre",
    ),
}


def refused(cause: str, **values: object) -> InvalidInputError:
    """Return the error for a cause, with what was found in its words."""
    refusal = REFUSALS[cause]
    return InvalidInputError(f"{refusal.words}; {refusal.remedy}".format(**values))
