"""Everything that can be asked of a session, as frozen dataclasses of plain values.

Commands change the session at once and purely. Activities take time or touch a device and end in
outcomes. Both are public: the browser, REST and scripts send the same ones.
"""

from typing import get_args

from rona_core.app.activity_messages import (
    StartMapping,
    StartPathCapture,
    StartPivotImport,
    StartPointerCapture,
    StartRecordingImport,
    StartRobotMove,
    StartRollSearch,
    StartScan,
    StartSecondPlan,
    StartSecondScan,
    StartSkullImport,
    StartSkullRegistration,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.app.commands import (
    BuildPath,
    BuildSurface,
    CalibratePointer,
    ChooseRoll,
    ClearSurface,
    ExcludePoses,
    MoveTracker,
    Point,
    Redo,
    RegisterTool,
    RenameSession,
    SetBone,
    SetPointer,
    SetProbe,
    SetReference,
    SetRegion,
    SetRobot,
    SetSeed,
    SetToolVisible,
    SetTracker,
    SmoothScanPath,
    Undo,
    UseSimulatedSkull,
)
from rona_core.app.path_commands import (
    ClearPathEdits,
    DeletePathPoint,
    DrawPattern,
    InsertPathPoint,
    KeepPathSample,
    MovePathPoint,
)
from rona_core.app.sono_messages import (
    CalibrateSono,
    StartSonoCalibration,
    StartSonoMapping,
    StartSonoScan,
)

Command = (
    RenameSession
    | SetSeed
    | UseSimulatedSkull
    | SetBone
    | SetRegion
    | SetTracker
    | MoveTracker
    | SetReference
    | SetToolVisible
    | SetRobot
    | SetProbe
    | SetPointer
    | RegisterTool
    | CalibratePointer
    | ExcludePoses
    | BuildSurface
    | ClearSurface
    | BuildPath
    | DrawPattern
    | SmoothScanPath
    | MovePathPoint
    | InsertPathPoint
    | DeletePathPoint
    | KeepPathSample
    | ClearPathEdits
    | ChooseRoll
    | CalibrateSono
    | Undo
    | Redo
)
Activity = (
    StartSkullImport
    | StartToolCapture
    | StartPointerCapture
    | StartSurfaceCapture
    | StartSkullRegistration
    | StartPathCapture
    | StartRecordingImport
    | StartPivotImport
    | StartRollSearch
    | StartScan
    | StartSecondPlan
    | StartSecondScan
    | StartMapping
    | StartSonoCalibration
    | StartSonoScan
    | StartSonoMapping
    | StartRobotMove
)
COMMANDS: dict[str, type] = {kind.__name__: kind for kind in get_args(Command)}
ACTIVITIES: dict[str, type] = {kind.__name__: kind for kind in get_args(Activity)}

__all__ = [
    "ACTIVITIES",
    "COMMANDS",
    "Activity",
    "BuildPath",
    "BuildSurface",
    "CalibratePointer",
    "CalibrateSono",
    "ChooseRoll",
    "ClearPathEdits",
    "ClearSurface",
    "Command",
    "DeletePathPoint",
    "DrawPattern",
    "ExcludePoses",
    "InsertPathPoint",
    "KeepPathSample",
    "MovePathPoint",
    "MoveTracker",
    "Point",
    "Redo",
    "RegisterTool",
    "RenameSession",
    "SetBone",
    "SetPointer",
    "SetProbe",
    "SetReference",
    "SetRegion",
    "SetRobot",
    "SetSeed",
    "SetToolVisible",
    "SetTracker",
    "SmoothScanPath",
    "StartMapping",
    "StartPathCapture",
    "StartPivotImport",
    "StartPointerCapture",
    "StartRecordingImport",
    "StartRobotMove",
    "StartRollSearch",
    "StartScan",
    "StartSecondPlan",
    "StartSecondScan",
    "StartSkullImport",
    "StartSkullRegistration",
    "StartSonoCalibration",
    "StartSonoMapping",
    "StartSonoScan",
    "StartSurfaceCapture",
    "StartToolCapture",
    "Undo",
    "UseSimulatedSkull",
]
