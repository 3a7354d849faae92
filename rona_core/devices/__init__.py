"""Device protocols, samples, settings and recordings, whether virtual, replayed or real."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rona_core.devices.files.poses.pose_columns import PoseLayout
    from rona_core.devices.files.poses.recorded_poses import read_pivot, read_poses
    from rona_core.devices.files.poses.sequences import read_igs_mha, write_igs_mha
    from rona_core.devices.files.rf.rf_data import read_rf, rf_from_arrays
    from rona_core.devices.protocols import Operator, Probe, Robot, Tracker
    from rona_core.devices.recording import Recording, ReplayTracker
    from rona_core.devices.settings import DeviceSettings

__all__ = [
    "DeviceSettings",
    "Operator",
    "PoseLayout",
    "Probe",
    "Recording",
    "ReplayTracker",
    "Robot",
    "Tracker",
    "read_igs_mha",
    "read_pivot",
    "read_poses",
    "read_rf",
    "rf_from_arrays",
    "write_igs_mha",
]

_MODULES = {
    "DeviceSettings": "settings",
    "Operator": "protocols",
    "PoseLayout": "files.poses.pose_columns",
    "Probe": "protocols",
    "Recording": "recording",
    "ReplayTracker": "recording",
    "Robot": "protocols",
    "Tracker": "protocols",
    "read_igs_mha": "files.poses.sequences",
    "read_pivot": "files.poses.recorded_poses",
    "read_poses": "files.poses.recorded_poses",
    "read_rf": "files.rf.rf_data",
    "rf_from_arrays": "files.rf.rf_data",
    "write_igs_mha": "files.poses.sequences",
}


def __getattr__(name: str) -> Any:
    """Load when asked: the process that reads foreign files starts without the rest."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
