"""Set-up: specimen, devices, work cell and seed."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.messages.message import copy_as, values_of
from rona_core.app.steps.setup import messages
from rona_core.devices.settings import (
    ContactSettings,
    ProbeSettings,
    RobotSettings,
    TrackerPlace,
)
from rona_core.devices.world_settings import WorldSettings
from rona_core.errors import NotFoundError
from rona_core.path.zones import PaintedRegions
from rona_core.robot.kinematics.catalog import figures_of, robot_model
from rona_core.session.document import RegionChoice, Session
from rona_core.session.specimen import BoneChoice, SimulatedSkull


def use_simulated_skull(message: messages.UseSimulatedSkull, session: Session) -> Session:
    """Carry out `UseSimulatedSkull`."""
    skull = SimulatedSkull(message.side)
    return _unpainted(session).with_setup(specimen=skull, region=RegionChoice())


def _unpainted(session: Session) -> Session:
    """Return the session without painted regions: they are of another bone or place."""
    return replace(session, painted=PaintedRegions())


def _with_tracker(session: Session, **settings: Any) -> Session:
    return session.with_devices(tracker=replace(session.setup.devices.tracker, **settings))


def set_tool_visible(message: messages.SetToolVisible, session: Session) -> Session:
    """Carry out `SetToolVisible`."""
    hidden = set(session.setup.devices.tracker.hidden_tools) - {message.tool}
    if not message.visible:
        hidden.add(message.tool)
    return _with_tracker(session, hidden_tools=tuple(sorted(hidden)))


def set_robot(message: messages.SetRobot, session: Session) -> Session:
    """Carry out `SetRobot`; how it presses the probe on stays as it was."""
    robot_model(message.model)  # refuses an unknown name
    before = session.setup.devices.robot
    robot = replace(before, **values_of(message, messages.SetRobot))
    if base_place(robot) != base_place(before):
        session = _unpainted(session)
    return session.with_devices(robot=robot)


def base_place(robot: RobotSettings) -> tuple[object, ...]:
    """Return what decides where the head is in ``base``: another arm has it elsewhere."""
    return robot.model, robot.base_shift_mm, robot.base_turn_deg


def set_contact(message: messages.SetContact, session: Session) -> Session:
    """Carry out `SetContact`."""
    contact = copy_as(ContactSettings, message) if message.pressed else None
    return session.with_devices(robot=replace(session.setup.devices.robot, contact=contact))


def set_workcell(message: messages.SetWorkcell, session: Session) -> Session:
    """Carry out `SetWorkcell`."""
    around = replace(session.setup.surroundings, **values_of(message, messages.SetWorkcell))
    return session.with_setup(surroundings=around)


def add_obstacle(message: messages.AddObstacle, session: Session) -> Session:
    """Carry out `AddObstacle`."""
    old = None if message.instead_of is None else message.instead_of.strip()
    return session.with_setup(surroundings=session.setup.surroundings.put(message.box(), old))


def remove_obstacle(message: messages.RemoveObstacle, session: Session) -> Session:
    """Carry out `RemoveObstacle`."""
    left = session.setup.surroundings.without(message.name.strip())
    return session.with_setup(surroundings=left)


def store_skull(message: messages.StoreSkull, session: Session) -> Session:
    """Put a skull that was read from a file on the table."""
    region = RegionChoice(None, message.skull.radius_mm)
    return _unpainted(session).with_setup(specimen=message.skull, region=region)


def import_uploaded_skull(
    activity: messages.StartSkullImport, session: Session, context: ActivityContext
) -> tuple[messages.StoreSkull]:
    """Read a skull from uploaded files.

    Raises:
        NotFoundError: one was not uploaded.
    """
    for name in (activity.file, activity.inner_file):
        if name and not (context.uploads / name).is_file():
            raise NotFoundError(f"there is no uploaded file {name!r}: upload it first")
    inner = activity.inner_file
    skull = context.run(
        context.import_skull,
        str(context.uploads / activity.file),
        str(context.uploads / inner) if inner else None,
        activity.threshold,
        activity.center_mesh_mm,
        activity.radius_mm,
        activity.label,
    )
    return (messages.StoreSkull(skull),)


def _summary(session: Session) -> str:
    devices = session.setup.devices
    specimen = getattr(session.setup.specimen, "name", "simulated skull")
    probe = devices.probe.name.replace("MHz", " MHz")
    return f"{specimen}, seed {session.setup.seed}, {probe}"


STEP = declare.Step(
    "setup",
    commands=(
        declare.Command(
            messages.SetSeed,
            lambda m, s: _unpainted(s).with_setup(seed=m.seed),
            done="the seed was changed",
        ),
        declare.Command(
            messages.UseSimulatedSkull,
            use_simulated_skull,
            done="the skull was replaced by a simulated one",
        ),
        declare.Command(
            messages.SetBoneModel,
            lambda m, s: s.with_setup(bone=copy_as(BoneChoice, m)),
            done="the bone model was changed",
        ),
        declare.Command(
            messages.SetWorld,
            lambda m, s: s.with_setup(world=copy_as(WorldSettings, m)),
            done="the virtual world was changed",
        ),
        declare.Command(
            messages.SetRegion,
            lambda m, s: s.with_setup(region=copy_as(RegionChoice, m)),
            done="the region was changed",
        ),
        declare.Command(
            messages.SetTracker,
            lambda m, s: _with_tracker(s, **values_of(m, messages.SetTracker)),
            done="the tracker was changed",
        ),
        declare.Command(
            messages.MoveTracker,
            lambda m, s: _with_tracker(s, place=copy_as(TrackerPlace, m)),
            done="the tracker was moved",
        ),
        declare.Command(
            messages.SetUseBaseMarker,
            lambda m, s: s.with_setup(use_base_marker=m.use_base_marker),
            done="the use of the base marker was changed",
        ),
        declare.Command(
            messages.SetToolVisible,
            set_tool_visible,
            done="the cover of a tracked tool was changed",
        ),
        declare.Command(messages.SetRobot, set_robot, done="the robot was changed"),
        declare.Command(messages.SetContact, set_contact, done="the contact force was changed"),
        declare.Command(messages.SetWorkcell, set_workcell, done="the work cell was changed"),
        declare.Command(
            messages.AddObstacle, add_obstacle, done="the obstacle was added or changed"
        ),
        declare.Command(messages.RemoveObstacle, remove_obstacle, done="the obstacle was removed"),
        declare.Command(
            messages.SetProbe,
            lambda m, s: s.with_devices(probe=copy_as(ProbeSettings, m)),
            done="the probe was changed",
        ),
        declare.Command(
            messages.SetPointer,
            lambda m, s: s.with_devices(pointer=m.kind),
            done="the pointer was changed",
        ),
    ),
    outcomes=(
        declare.Command(messages.StoreSkull, store_skull, done="the skull was read from a file"),
    ),
    activities=(
        declare.Activity(messages.StartSkullImport, import_uploaded_skull, "Reading the skull"),
    ),
    line=declare.StepLine("Set-up", _summary),
)


@dataclass(frozen=True, slots=True)
class RobotFigure:
    """One figure of a robot and its origin."""

    name: str
    key: str  # by which it is overridden; empty where only another description file can
    values: tuple[float, ...]
    unit: str
    trust: str
    sourced: bool  # false: assumed, without a source
    source: str


@lru_cache(maxsize=4)
def robot_figures(model: str) -> tuple[RobotFigure, ...]:
    """Return the rows of one robot.

    Raises:
        InvalidInputError: no robot of that name, or its description is not installed.
    """
    return tuple(
        RobotFigure(f.name, f.key, f.values, f.unit, f.trust, f.sourced, f.source)
        for f in figures_of(model)
    )
