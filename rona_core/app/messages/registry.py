"""Everything that can be asked of a session, as frozen dataclasses of plain values.

Commands change the session at once and purely. Activities take time or touch a device and end in
outcomes. Both are public: the browser, REST and scripts send the same ones.
"""

from typing import get_args

from rona_core.app.messages.activities import (
    StartBasePlacement,
    StartMapping,
    StartPathCapture,
    StartPivotImport,
    StartPointerCapture,
    StartRecordingImport,
    StartReplay,
    StartRetract,
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
from rona_core.app.messages.commands import (
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
from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateDelayLine,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartBlockShots,
    StartReferencePoints,
    StartWhatIf,
)
from rona_core.app.steps.handheld.messages import (
    CalibrateSono,
    StartSonoCalibration,
    StartSonoMapping,
    StartSonoScan,
)
from rona_core.app.steps.path.messages import (
    ClearPathEdits,
    DeletePathPoint,
    DrawPattern,
    InsertPathPoint,
    KeepPathSample,
    MovePathPoint,
)
from rona_core.app.steps.scan.boundary_messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.setup.robot_messages import ApplyBasePlacement, SetContact
from rona_core.app.steps.setup.workcell_messages import PutObstacle, RemoveObstacle, SetSurroundings

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
    | SetContact
    | SetSurroundings
    | PutObstacle
    | RemoveObstacle
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
    | ApplyBasePlacement
    | CorrectBoundary
    | ClearBoundaryCorrections
    | AddReferencePoint
    | RemoveReferencePoint
    | CalibrateSoundSpeed
    | CalibrateDelayLine
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
    | StartBasePlacement
    | StartScan
    | StartSecondPlan
    | StartSecondScan
    | StartMapping
    | StartReferencePoints
    | StartBlockShots
    | StartWhatIf
    | StartSonoCalibration
    | StartSonoScan
    | StartSonoMapping
    | StartReplay
    | StartRobotMove
    | StartRetract
)
COMMANDS: dict[str, type] = {kind.__name__: kind for kind in get_args(Command)}
ACTIVITIES: dict[str, type] = {kind.__name__: kind for kind in get_args(Activity)}

__all__ = [
    "ACTIVITIES",
    "COMMANDS",
    "Activity",
    "AddReferencePoint",
    "ApplyBasePlacement",
    "BuildPath",
    "BuildSurface",
    "CalibrateDelayLine",
    "CalibratePointer",
    "CalibrateSono",
    "CalibrateSoundSpeed",
    "ChooseRoll",
    "ClearBoundaryCorrections",
    "ClearPathEdits",
    "ClearSurface",
    "Command",
    "CorrectBoundary",
    "DeletePathPoint",
    "DrawPattern",
    "ExcludePoses",
    "InsertPathPoint",
    "KeepPathSample",
    "MovePathPoint",
    "MoveTracker",
    "Point",
    "PutObstacle",
    "Redo",
    "RegisterTool",
    "RemoveObstacle",
    "RemoveReferencePoint",
    "RenameSession",
    "SetBone",
    "SetContact",
    "SetPointer",
    "SetProbe",
    "SetReference",
    "SetRegion",
    "SetRobot",
    "SetSeed",
    "SetSurroundings",
    "SetToolVisible",
    "SetTracker",
    "SmoothScanPath",
    "StartBasePlacement",
    "StartBlockShots",
    "StartMapping",
    "StartPathCapture",
    "StartPivotImport",
    "StartPointerCapture",
    "StartRecordingImport",
    "StartReferencePoints",
    "StartReplay",
    "StartRetract",
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
    "StartWhatIf",
    "Undo",
    "UseSimulatedSkull",
]
