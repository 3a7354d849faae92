"""Messages of the implant bed."""

from rona_core.app.messages.message import message, within
from rona_core.devices.limits import PLACE, limited
from rona_core.planning.implants.catalogue import CATALOGUE

Corners = tuple[tuple[float, float], ...]  # u and v in the plane of the maps, in mm
IMPLANTS = tuple(CATALOGUE)  # by name
# what a bed keeps away from: each a point, a line or an area
AVOIDED = {**PLACE, "maxItems": 20, "items": {"minItems": 1, "maxItems": 200}}


@message
class StartBedSearch:
    """Search the place, turn and tilt at which an implant's bed most surely leaves enough bone.

    Without a lift the smallest whole millimetre that is safe is taken. What is to be avoided (a
    sinus, a suture, an older screw) is a point, a line, or an area whose last corner is its first.
    """

    implant: str = limited("BCI 602", enum=IMPLANTS)
    limit_mm: float = within(0.0, 10.0, default=1.0)  # of bone left below the bed
    probability: float = within(0.5, 0.9999, default=0.99)  # of that, and of bone for each screw
    lift_mm: float | None = within(0.0, 4.0, default=None)
    burr_mm: float | None = within(0.5, 12.0, default=None)  # None: the largest of four that fits
    avoid: tuple[Corners, ...] = limited((), **AVOIDED)
    avoid_mm: float = within(0.0, 50.0, default=2.0)  # by which the bed keeps away from these


@message
class PlaceBed:
    """Lay the bed of an implant at a chosen place of the map; tell what bone it leaves."""

    u_mm: float = within(-200.0, 200.0)  # of its middle, in the plane of the maps
    v_mm: float = within(-200.0, 200.0)
    angle_deg: float = within(-180.0, 180.0, default=0.0)
    tilt_x_deg: float = within(-15.0, 15.0, default=0.0)
    tilt_y_deg: float = within(-15.0, 15.0, default=0.0)
    implant: str = limited("BCI 602", enum=IMPLANTS)
    limit_mm: float = within(0.0, 10.0, default=1.0)
    probability: float = within(0.5, 0.9999, default=0.99)
    lift_mm: float = within(0.0, 4.0, default=0.0)
    burr_mm: float | None = within(0.5, 12.0, default=None)
    avoid: tuple[Corners, ...] = limited((), **AVOIDED)
    avoid_mm: float = within(0.0, 50.0, default=2.0)


@message
class StartBedLines:
    """Find the further scan lines that tell most of the bone below the bed of step 10.

    `StartGapPlan` takes their `rows` and plans how the robot scans them.
    """

    length_mm: float = within(20.0, 500.0, default=60.0)  # of all lines together, about


@message
class PlanMilling:
    """Plan how the robot mills the bed: roll about the burr, timing, collisions, certificate."""

    n_rolls: int = within(1, 360, default=36)


@message
class RehearseMilling:
    """Rehearse the planned milling on the virtual patient's true bone, with force and re-scan.

    Each number is another rehearsal: with other noise, and the burr put in anew.
    """

    number: int = within(1, 10_000, default=1)
