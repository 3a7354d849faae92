"""Messages of the implant bed."""

from dataclasses import MISSING

from rona_core.app.messages.message import message
from rona_core.devices.limits import PLACE_MM, choice, like, number
from rona_core.planning.implants.implant import CATALOGUE
from rona_core.planning.milling.plan_milling import BURRS_MM

Corners = tuple[tuple[float, float], ...]  # u and v in the plane of the maps, in mm
IMPLANTS = {name: name for name in CATALOGUE}


@message
class StartBedSearch:
    """Search the place, turn and tilt at which an implant's bed most surely leaves enough bone.

    Without a lift the smallest whole millimetre that is safe is taken. What is to be avoided (a
    sinus, a suture, an older screw) is a point, a line, or an area whose last corner is its first.
    """

    implant: str = choice("BCI 602", "Implant", IMPLANTS, "Implant whose bed is searched")
    limit_mm: float = number(
        1.0, "Bone below", "mm", 0.0, 10.0, 0.1, hint="That must be left everywhere below the bed"
    )
    probability: float = number(
        0.99,
        "Probability",
        "",
        0.5,
        0.9999,
        0.01,
        hint="Of that bone, and of enough for each screw",
    )
    lift_mm: float | None = number(
        None,
        "Lift",
        "mm",
        0.0,
        4.0,
        1.0,
        hint="Spacer that raises the implant",
        none="Smallest that is safe",
        offered=(0.0, 1.0, 2.0, 3.0, 4.0),
    )
    burr_mm: float | None = number(
        None,
        "Burr diameter",
        "mm",
        0.5,
        12.0,
        0.5,
        hint="A ball",
        none="Largest that fits",
        offered=BURRS_MM,
    )
    avoid: tuple[Corners, ...] = number(
        (),
        "To be avoided",
        "mm",
        *PLACE_MM,
        0.5,
        hint="Points, lines and areas",
        maxItems=20,
        items={"minItems": 1, "maxItems": 200},
    )
    avoid_mm: float = number(
        2.0, "Distance kept", "mm", 0.0, 50.0, 0.5, hint="Of the bed from what is to be avoided"
    )


@message
class PlaceBed:
    """Lay the bed of an implant at a chosen place of the map; tell what bone it leaves."""

    u_mm: float = number(
        MISSING, "Along u", "mm", -200.0, 200.0, 0.5, hint="Of the middle of the bed in the maps"
    )
    v_mm: float = number(
        MISSING, "Along v", "mm", -200.0, 200.0, 0.5, hint="Of the middle of the bed in the maps"
    )
    angle_deg: float = number(
        0.0, "Angle", "deg", -180.0, 180.0, 1.0, hint="Of the bed in the plane of the maps"
    )
    tilt_x_deg: float = number(
        0.0, "Tilt about x", "deg", -15.0, 15.0, 0.5, hint="Of the bed about its longer side"
    )
    tilt_y_deg: float = number(
        0.0, "Tilt about y", "deg", -15.0, 15.0, 0.5, hint="Of the bed about its shorter side"
    )
    implant: str = like(StartBedSearch, "implant")
    limit_mm: float = like(StartBedSearch, "limit_mm")
    probability: float = like(StartBedSearch, "probability")
    lift_mm: float = number(
        0.0, "Lift by hand", "mm", 0.0, 4.0, 0.25, hint="Raises the implant out of its bed"
    )
    burr_mm: float | None = like(StartBedSearch, "burr_mm")
    avoid: tuple[Corners, ...] = like(StartBedSearch, "avoid")
    avoid_mm: float = like(StartBedSearch, "avoid_mm")


@message
class StartBedLines:
    """Find the further scan lines that tell most of the bone below the bed of step 10.

    `StartTiltPlan` takes their `rows` and plans how the robot scans them.
    """

    length_mm: float = number(
        60.0, "Length of the lines", "mm", 20.0, 500.0, 5.0, hint="Of all together, about"
    )


@message
class PlanMilling:
    """Plan how the robot mills the bed: roll about the burr, timing, collisions, certificate."""

    n_rolls: int = number(36, "Roll angles", "", 1, 360, 1, hint="About the burr")


@message
class RehearseMilling:
    """Rehearse the planned milling on the virtual patient's true bone, with force and re-scan.

    Each number is another rehearsal: with other noise, and the burr put in anew.
    """

    number: int = number(1, "Rehearsal no.", "", 1, 10_000, 1, hint="Seed of its noise")
