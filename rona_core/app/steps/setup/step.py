"""Set-up: specimen, devices, work cell and seed."""

from dataclasses import replace

from rona_core.app.declarations.declarations import (
    Activity,
    ActivityContext,
    Command,
    Step,
    StepLine,
)
from rona_core.app.messages.message import values_of
from rona_core.app.messages.outcomes import StoreSkull
from rona_core.app.steps.setup.messages import (
    AddObstacle,
    MoveTracker,
    RemoveObstacle,
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
    StartSkullImport,
    UseSimulatedSkull,
)
from rona_core.devices.settings import (
    ContactSettings,
    DeviceSettings,
    ProbeSettings,
    TrackerPlace,
)
from rona_core.devices.workcell import Surroundings
from rona_core.errors import NotFoundError
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
    return replace(
        session, setup=replace(session.setup, bone=BoneChoice(**values_of(message, BoneChoice)))
    )


def set_region(message: SetRegion, session: Session) -> Session:
    """Carry out `SetRegion`."""
    return replace(
        session,
        setup=replace(session.setup, region=RegionChoice(**values_of(message, RegionChoice))),
    )


def _with_devices(session: Session, devices: DeviceSettings) -> Session:
    return replace(session, setup=replace(session.setup, devices=devices))


def set_tracker(message: SetTracker, session: Session) -> Session:
    """Carry out `SetTracker`."""
    devices = session.setup.devices
    tracker = replace(devices.tracker, **values_of(message, SetTracker))
    return _with_devices(session, replace(devices, tracker=tracker))


def move_tracker(message: MoveTracker, session: Session) -> Session:
    """Carry out `MoveTracker`."""
    devices = session.setup.devices
    tracker = replace(devices.tracker, place=TrackerPlace(**values_of(message, TrackerPlace)))
    return _with_devices(session, replace(devices, tracker=tracker))


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
    robot = replace(
        devices.robot, **values_of(message, SetRobot)
    )  # how it presses on stays as it was
    return _with_devices(session, replace(devices, robot=robot))


def set_contact(message: SetContact, session: Session) -> Session:
    """Carry out `SetContact`."""
    devices = session.setup.devices
    contact = ContactSettings(**values_of(message, ContactSettings)) if message.pressed else None
    robot = replace(devices.robot, contact=contact)
    return _with_devices(session, replace(devices, robot=robot))


def _among(session: Session, surroundings: Surroundings) -> Session:
    return replace(session, setup=replace(session.setup, surroundings=surroundings))


def set_workcell(message: SetWorkcell, session: Session) -> Session:
    """Carry out `SetWorkcell`."""
    return _among(session, replace(session.setup.surroundings, **values_of(message, SetWorkcell)))


def add_obstacle(message: AddObstacle, session: Session) -> Session:
    """Carry out `AddObstacle`."""
    old = None if message.instead_of is None else message.instead_of.strip()
    return _among(session, session.setup.surroundings.put(message.box(), old))


def remove_obstacle(message: RemoveObstacle, session: Session) -> Session:
    """Carry out `RemoveObstacle`."""
    return _among(session, session.setup.surroundings.without(message.name.strip()))


def set_probe(message: SetProbe, session: Session) -> Session:
    """Carry out `SetProbe`."""
    probe = ProbeSettings(**values_of(message, ProbeSettings))
    return _with_devices(session, replace(session.setup.devices, probe=probe))


def set_pointer(message: SetPointer, session: Session) -> Session:
    """Carry out `SetPointer`."""
    return _with_devices(session, replace(session.setup.devices, pointer=message.kind))


def import_uploaded_skull(
    activity: StartSkullImport, session: Session, context: ActivityContext
) -> tuple[StoreSkull]:
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
    )
    return (StoreSkull(skull),)


def _summary(session: Session) -> str:
    devices = session.setup.devices
    specimen = getattr(session.setup.specimen, "name", "simulated skull")
    probe = devices.probe.name.replace("MHz", " MHz")
    return f"{specimen}, seed {session.setup.seed}, {probe}"


STEP = Step(
    "setup",
    commands=(
        Command(SetSeed, set_seed),
        Command(UseSimulatedSkull, use_simulated_skull),
        Command(SetBoneModel, set_bone_model),
        Command(SetRegion, set_region),
        Command(SetTracker, set_tracker),
        Command(MoveTracker, move_tracker),
        Command(SetUseBaseMarker, set_use_base_marker),
        Command(SetToolVisible, set_tool_visible),
        Command(SetRobot, set_robot),
        Command(SetContact, set_contact),
        Command(SetWorkcell, set_workcell),
        Command(AddObstacle, add_obstacle),
        Command(RemoveObstacle, remove_obstacle),
        Command(SetProbe, set_probe),
        Command(SetPointer, set_pointer),
    ),
    activities=(Activity(StartSkullImport, import_uploaded_skull, "Reading the skull"),),
    line=StepLine("Set-up", _summary),
)
