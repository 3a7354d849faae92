"""Everything that can be asked of a session, as frozen dataclasses of plain values.

Commands change the session at once and purely. Activities take time or touch a device and end in
outcomes. Both are public: the browser, REST and scripts send the same ones.
"""

from typing import get_args

from rona_core.app.messages.activities import (
    StartBasePlacement,
    StartGapPlan,
    StartGapScan,
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
    SetBoneModel,
    SetPointer,
    SetProbe,
    SetRegion,
    SetRobot,
    SetSeed,
    SetToolVisible,
    SetTracker,
    SetUseBaseMarker,
    SmoothScanPath,
    Undo,
    UseSimulatedSkull,
)
from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateDelayLine,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartCaliperMeasurements,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.handheld.messages import (
    CalibrateHandheldProbe,
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.path.messages import (
    ClearPathEdits,
    DeletePathPoint,
    GenerateScanPattern,
    InsertPathPoint,
    MovePathPoint,
    PinPathSample,
)
from rona_core.app.steps.scan.boundary_messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.setup.robot_messages import ApplyBasePlacement, SetContact
from rona_core.app.steps.setup.workcell_messages import AddObstacle, RemoveObstacle, SetWorkcell

Command = (
    RenameSession
    | SetSeed
    | UseSimulatedSkull
    | SetBoneModel
    | SetRegion
    | SetTracker
    | MoveTracker
    | SetUseBaseMarker
    | SetToolVisible
    | SetRobot
    | SetContact
    | SetWorkcell
    | AddObstacle
    | RemoveObstacle
    | SetProbe
    | SetPointer
    | RegisterTool
    | CalibratePointer
    | ExcludePoses
    | BuildSurface
    | ClearSurface
    | BuildPath
    | GenerateScanPattern
    | SmoothScanPath
    | MovePathPoint
    | InsertPathPoint
    | DeletePathPoint
    | PinPathSample
    | ClearPathEdits
    | ChooseRoll
    | ApplyBasePlacement
    | CorrectBoundary
    | ClearBoundaryCorrections
    | AddReferencePoint
    | RemoveReferencePoint
    | CalibrateSoundSpeed
    | CalibrateDelayLine
    | CalibrateHandheldProbe
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
    | StartGapPlan
    | StartGapScan
    | StartMapping
    | StartCaliperMeasurements
    | StartDelayLineCapture
    | StartProbeSweep
    | StartHandheldCalibration
    | StartHandheldScan
    | StartHandheldMapping
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
    "AddObstacle",
    "AddReferencePoint",
    "ApplyBasePlacement",
    "BuildPath",
    "BuildSurface",
    "CalibrateDelayLine",
    "CalibrateHandheldProbe",
    "CalibratePointer",
    "CalibrateSoundSpeed",
    "ChooseRoll",
    "ClearBoundaryCorrections",
    "ClearPathEdits",
    "ClearSurface",
    "Command",
    "CorrectBoundary",
    "DeletePathPoint",
    "ExcludePoses",
    "GenerateScanPattern",
    "InsertPathPoint",
    "MovePathPoint",
    "MoveTracker",
    "PinPathSample",
    "Point",
    "Redo",
    "RegisterTool",
    "RemoveObstacle",
    "RemoveReferencePoint",
    "RenameSession",
    "SetBoneModel",
    "SetContact",
    "SetPointer",
    "SetProbe",
    "SetRegion",
    "SetRobot",
    "SetSeed",
    "SetToolVisible",
    "SetTracker",
    "SetUseBaseMarker",
    "SetWorkcell",
    "SmoothScanPath",
    "StartBasePlacement",
    "StartCaliperMeasurements",
    "StartDelayLineCapture",
    "StartGapPlan",
    "StartGapScan",
    "StartHandheldCalibration",
    "StartHandheldMapping",
    "StartHandheldScan",
    "StartMapping",
    "StartPathCapture",
    "StartPivotImport",
    "StartPointerCapture",
    "StartProbeSweep",
    "StartRecordingImport",
    "StartReplay",
    "StartRetract",
    "StartRobotMove",
    "StartRollSearch",
    "StartScan",
    "StartSkullImport",
    "StartSkullRegistration",
    "StartSurfaceCapture",
    "StartToolCapture",
    "Undo",
    "UseSimulatedSkull",
]
