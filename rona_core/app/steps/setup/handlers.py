"""What the messages of the set-up do to a session: pure functions from a session to the next."""

from dataclasses import fields, replace
from functools import singledispatch
from typing import Any

from rona_core.app.messages.outcomes import (
    StoreSkull,
)
from rona_core.app.messages.registry import (
    AddObstacle,
    MoveTracker,
    RemoveObstacle,
    RenameSession,
    SetBoneModel,
    SetContact,
    SetPointer,
    SetProbe,
    SetRegion,
    SetRobot,
    SetSeed,
    SetToolVisible,
    SetTracker,
    SetUseBaseMarker,
    SetWorkcell,
    UseSimulatedSkull,
)
from rona_core.devices.settings import (
    DeviceSettings,
    ProbeSettings,
    RobotSettings,
    TrackerPlace,
)
from rona_core.devices.workcell import Surroundings
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import RegionChoice, Session
from rona_core.session.specimen import BoneChoice, SimulatedSkull


@singledispatch
def handle(message: Any, session: Session) -> Session:
    """Return the session after ``message``; the one that came in stays as it was.

    Raises:
        RonaError: the message does not fit the session.
    """
    raise InvalidInputError(f"there is no handler for {type(message).__name__}")


@handle.register
def _(message: RenameSession, session: Session) -> Session:
    return replace(session, name=message.name.strip())


@handle.register
def _(message: SetSeed, session: Session) -> Session:
    return replace(session, setup=replace(session.setup, seed=message.seed))


@handle.register
def _(message: UseSimulatedSkull, session: Session) -> Session:
    skull, region = SimulatedSkull(side=message.side), RegionChoice()
    return replace(session, setup=replace(session.setup, specimen=skull, region=region))


@handle.register
def _(message: SetBoneModel, session: Session) -> Session:
    bone = BoneChoice(message.kind, message.own_speed)
    return replace(session, setup=replace(session.setup, bone=bone))


@handle.register
def _(message: SetRegion, session: Session) -> Session:
    region = RegionChoice(message.center_mesh_mm, message.radius_mm)
    return replace(session, setup=replace(session.setup, region=region))


def _chosen(message: Any) -> dict[str, Any]:
    return {part.name: getattr(message, part.name) for part in fields(message)}


def _with_devices(session: Session, devices: DeviceSettings) -> Session:
    return replace(session, setup=replace(session.setup, devices=devices))


@handle.register
def _(message: SetTracker, session: Session) -> Session:
    devices = session.setup.devices
    tracker = replace(devices.tracker, **_chosen(message))
    return _with_devices(session, replace(devices, tracker=tracker))


@handle.register
def _(message: MoveTracker, session: Session) -> Session:
    devices = session.setup.devices
    place = TrackerPlace(message.shift_mm, message.turn_deg)
    return _with_devices(session, replace(devices, tracker=replace(devices.tracker, place=place)))


@handle.register
def _(message: SetUseBaseMarker, session: Session) -> Session:
    setup = replace(session.setup, use_base_marker=message.use_base_marker)
    return replace(session, setup=setup)


@handle.register
def _(message: SetToolVisible, session: Session) -> Session:
    devices = session.setup.devices
    hidden = set(devices.tracker.hidden_tools) - {message.tool}
    if not message.visible:
        hidden.add(message.tool)
    tracker = replace(devices.tracker, hidden_tools=tuple(sorted(hidden)))
    return _with_devices(session, replace(devices, tracker=tracker))


@handle.register
def _(message: SetRobot, session: Session) -> Session:
    robot_model(message.model)  # refuses an unknown name
    devices = session.setup.devices
    robot = replace(devices.robot, **_chosen(message))  # how it presses on stays as it was
    return _with_devices(session, replace(devices, robot=robot))


def robot_choice(robot: RobotSettings) -> dict[str, Any]:
    """Return the part of a robot's settings that the message ``SetRobot`` has."""
    return {part.name: getattr(robot, part.name) for part in fields(SetRobot)}


@handle.register
def _(message: SetContact, session: Session) -> Session:
    devices = session.setup.devices
    robot = replace(devices.robot, contact=message.settings())
    return _with_devices(session, replace(devices, robot=robot))


def _among(session: Session, surroundings: Surroundings) -> Session:
    return replace(session, setup=replace(session.setup, surroundings=surroundings))


@handle.register
def _(message: SetWorkcell, session: Session) -> Session:
    return _among(session, replace(session.setup.surroundings, **message.chosen()))


@handle.register
def _(message: AddObstacle, session: Session) -> Session:
    old = None if message.instead_of is None else message.instead_of.strip()
    return _among(session, session.setup.surroundings.put(message.box(), old))


@handle.register
def _(message: RemoveObstacle, session: Session) -> Session:
    return _among(session, session.setup.surroundings.without(message.name.strip()))


@handle.register
def _(message: SetProbe, session: Session) -> Session:
    settings = ProbeSettings(**_chosen(message))
    return _with_devices(session, replace(session.setup.devices, probe=settings))


@handle.register
def _(message: SetPointer, session: Session) -> Session:
    return _with_devices(session, replace(session.setup.devices, pointer=message.kind))


@handle.register
def _(message: StoreSkull, session: Session) -> Session:
    region = RegionChoice(None, message.skull.radius_mm)
    return replace(session, setup=replace(session.setup, specimen=message.skull, region=region))
