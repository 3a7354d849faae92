"""Thickness from a recording without a session: for the command line and scripts."""

from dataclasses import dataclass

from rona_core.devices.files.rf.rf_data import RecordedRf, read_rf
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.protocols import Progress, silent
from rona_core.errors import InvalidInputError
from rona_core.mapping.thickness_figures import ThicknessFigures, thickness_figures
from rona_core.ultrasound.probe.probe_model import probe_model
from rona_core.ultrasound.recorded.plate_detector import RecordedDetection, detect_recorded

SPEEDS_M_PER_S = (500.0, 10_000.0)


@dataclass(frozen=True, slots=True, eq=False)
class RfReport:
    """What was read, what was found, and what that amounts to."""

    recorded: RecordedRf
    detection: RecordedDetection
    summary: ThicknessFigures

    def figures(self) -> dict[str, object]:
        """Return the figures as plain values; a thickness is None where the scan is flagged."""
        found, summary = self.detection, self.summary
        return {
            "n_scans": summary.n_scans,
            "mean_thickness_mm": summary.mean_mm,
            "robust_sd_mm": summary.robust_sd_mm,
            "failure_fraction": summary.failure_fraction,
            "flagged_fraction": summary.flagged_fraction,
            "thickness_mm": [
                float(value) if ok else None
                for value, ok in zip(found.thickness_mm, found.ok, strict=True)
            ],
        }


def report_rf(
    file: NamedFile,
    speed_m_per_s: float,
    *,
    probe: str | None = None,
    progress: Progress = silent,
) -> RfReport:
    """Read a recording as ``devices.rf_files.read_rf`` does, and measure the plate in it.

    Args:
        file: HDF5, .mat or .npz.
        speed_m_per_s: Sound speed in the plate.
        probe: Name of the probe that took it; it only says where the band is sought.
        progress: Receives the share that is done, 0 to 1.

    Raises:
        InvalidInputError: the file holds no lines, an impossible speed, or no such probe.
        DegenerateGeometryError: there is no echo in the lines.
    """
    low, high = SPEEDS_M_PER_S
    if not low <= speed_m_per_s <= high:
        hint = ": m/s are meant" if 0.1 <= speed_m_per_s <= 10 else ""
        raise InvalidInputError(
            f"the sound speed must be {low:g} to {high:g} m/s, not {speed_m_per_s:g}{hint}"
        )
    prior_mhz = None if probe is None else probe_model(probe).centre_mhz
    recorded = read_rf(file)
    found = detect_recorded(recorded, speed_m_per_s * 1e-3, prior_mhz=prior_mhz, progress=progress)
    summary = thickness_figures(found.thickness_mm, found.ok, recorded.positions_mm)
    return RfReport(recorded, found, summary)
