"""What the messages of the set-up do to a session: pure functions from a session to the next."""

from dataclasses import fields, replace
from typing import Any

from rona_core.app.declarations.declarations import Message
from rona_core.app.steps.setup.contact_messages import SetContact
from rona_core.app.steps.setup.messages import (
    MoveTracker,
    SetBoneModel,
    SetPointer,
    SetProbe,
    SetRegion,
    SetRobot,
    SetSeed,
    SetToolVisible,
    SetTracker,
    SetUseBaseMarker,
    UseSimulatedSkull,
)
from rona_core.app.steps.setup.workcell_messages import AddObstacle, RemoveObstacle, SetWorkcell
from rona_core.devices.settings import (
    DeviceSettings,
    ProbeSettings,
    RobotSettings,
    TrackerPlace,
)
from rona_core.devices.workcell import Surroundings
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import RegionChoice, Session
from rona_core.session.specimen import BoneChoice, SimulatedSkull


def set_seed(message: SetSeed, session: Session) -> Session:
    """Carry out `SetSeed`."""
    return replace(session, setup=replace(session.setup, seed=message.seed))


def use_simulated_skull(message: UseSimulatedSkull, session: Session) -> Session:
    """Carry out `UseSimulatedSkull`."""
    skull, region = SimulatedSkull(side=message.side), RegionChoice()
    return replace(session, setup=replace(session.setup, specimen=skull, region=region))


def set_bone_model(message: SetBoneModel, session: Session) -> Session:
    """Carry out `SetBoneModel`."""
    bone = BoneChoice(message.kind, message.own_speed)
    return replace(session, setup=replace(session.setup, bone=bone))


def set_region(message: SetRegion, session: Session) -> Session:
    """Carry out `SetRegion`."""
    region = RegionChoice(message.center_mesh_mm, message.radius_mm)
    return replace(session, setup=replace(session.setup, region=region))


def _chosen(message: Message) -> dict[str, Any]:
    return {part.name: getattr(message, part.name) for part in fields(message)}


def _with_devices(session: Session, devices: DeviceSettings) -> Session:
    return replace(session, setup=replace(session.setup, devices=devices))


def set_tracker(message: SetTracker, session: Session) -> Session:
    """Carry out `SetTracker`."""
    devices = session.setup.devices
    tracker = replace(devices.tracker, **_chosen(message))
    return _with_devices(session, replace(devices, tracker=tracker))


def move_tracker(message: MoveTracker, session: Session) -> Session:
    """Carry out `MoveTracker`."""
    devices = session.setup.devices
    place = TrackerPlace(message.shift_mm, message.turn_deg)
    return _with_devices(session, replace(devices, tracker=replace(devices.tracker, place=place)))


def set_use_base_marker(message: SetUseBaseMarker, session: Session) -> Session:
    """Carry out `SetUseBaseMarker`."""
    setup = replace(session.setup, use_base_marker=message.use_base_marker)
    return replace(session, setup=setup)


def set_tool_visible(message: SetToolVisible, session: Session) -> Session:
    """Carry out `SetToolVisible`."""
    devices = session.setup.devices
    hidden = set(devices.tracker.hidden_tools) - {message.tool}
    if not message.visible:
        hidden.add(message.tool)
    tracker = replace(devices.tracker, hidden_tools=tuple(sorted(hidden)))
    return _with_devices(session, replace(devices, tracker=tracker))


def set_robot(message: SetRobot, session: Session) -> Session:
    """Carry out `SetRobot`."""
    robot_model(message.model)  # refuses an unknown name
    devices = session.setup.devices
    robot = replace(devices.robot, **_chosen(message))  # how it presses on stays as it was
    return _with_devices(session, replace(devices, robot=robot))


def robot_choice(robot: RobotSettings) -> dict[str, Any]:
    """Return the part of a robot's settings that the message ``SetRobot`` has."""
    return {part.name: getattr(robot, part.name) for part in fields(SetRobot)}


def set_contact(message: SetContact, session: Session) -> Session:
    """Carry out `SetContact`."""
    devices = session.setup.devices
    robot = replace(devices.robot, contact=message.settings())
    return _with_devices(session, replace(devices, robot=robot))


def _among(session: Session, surroundings: Surroundings) -> Session:
    return replace(session, setup=replace(session.setup, surroundings=surroundings))


def set_workcell(message: SetWorkcell, session: Session) -> Session:
    """Carry out `SetWorkcell`."""
    return _among(session, replace(session.setup.surroundings, **message.chosen()))


def add_obstacle(message: AddObstacle, session: Session) -> Session:
    """Carry out `AddObstacle`."""
    old = None if message.instead_of is None else message.instead_of.strip()
    return _among(session, session.setup.surroundings.put(message.box(), old))


def remove_obstacle(message: RemoveObstacle, session: Session) -> Session:
    """Carry out `RemoveObstacle`."""
    return _among(session, session.setup.surroundings.without(message.name.strip()))


def set_probe(message: SetProbe, session: Session) -> Session:
    """Carry out `SetProbe`."""
    settings = ProbeSettings(**_chosen(message))
    return _with_devices(session, replace(session.setup.devices, probe=settings))


def set_pointer(message: SetPointer, session: Session) -> Session:
    """Carry out `SetPointer`."""
    return _with_devices(session, replace(session.setup.devices, pointer=message.kind))
