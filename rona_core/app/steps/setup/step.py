"""Set-up: specimen, devices, work cell and seed."""

from rona_core.app.declarations.declarations import Activity, Command, Step, StepLine
from rona_core.app.steps.setup.contact_messages import SetContact
from rona_core.app.steps.setup.handlers import (
    add_obstacle,
    move_tracker,
    remove_obstacle,
    set_bone_model,
    set_contact,
    set_pointer,
    set_probe,
    set_region,
    set_robot,
    set_seed,
    set_tool_visible,
    set_tracker,
    set_use_base_marker,
    set_workcell,
    use_simulated_skull,
)
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
    StartSkullImport,
    UseSimulatedSkull,
)
from rona_core.app.steps.setup.skull_import import import_uploaded_skull
from rona_core.app.steps.setup.workcell_messages import AddObstacle, RemoveObstacle, SetWorkcell
from rona_core.session.document import Session


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
