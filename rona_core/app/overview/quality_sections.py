"""Figures of a session by section, with what was predicted beside what came true."""

from collections.abc import Iterable
from dataclasses import dataclass

from rona_core.app.overview.acceptance import QualityRow

MAPS = "outer inner thickness fused coverage detection unfl flagged scan_thick sound"
SCAN = "roll landmark scan_p scan_d min_ contact head second references"
SECTIONS = (  # title, what the keys begin with, steps that the figures come from
    ("Calibration", "tool_tip tracker_reg pointer_tip", ("tool", "pointer")),
    ("Surface and path", "surface skull_reg path normal", ("surface", "path", "smoothing")),
    ("Robot and scan", SCAN, ("roll", "scan")),
    ("Maps", MAPS, ("maps",)),
    ("Implant bed", "burr bed milling rehearsal", ("implant",)),
    ("Handheld scan", "sono", ()),
)
# true error -> what the program expects of it without the truth
PREDICTED = {
    "tool_tip_error_mm": "tool_tip_sigma_mm",
    "tracker_registration_tre_mm": "tracker_registration_sigma_mm",
    "pointer_tip_error_mm": "pointer_tip_sigma_mm",
    "surface_rms_mm": "surface_sigma_predicted_mm",
    "skull_registration_tre_mm": "skull_registration_sigma_mm",
    "landmark_distance_mm": "landmark_sigma_mm",
    "burr_tip_error_mm": "burr_tip_sigma_mm",
    "scan_thickness_rms_mm": "thickness_sigma_predicted_mm",
}


@dataclass(frozen=True, slots=True)
class QualitySection:
    """Figures that belong together, each with the prediction of it where there is one."""

    title: str
    steps: tuple[str, ...]  # that they come from
    rows: tuple[tuple[QualityRow, QualityRow | None], ...]
    left_out: tuple[QualityRow, ...]  # of stale results


@dataclass(frozen=True, slots=True)
class QualityTable:
    """All figures that have a value: predictions first, then sections versus ground truth."""

    predicted: tuple[QualityRow, ...]
    sections: tuple[QualitySection, ...]  # those that are not empty


def quality_table(rows: Iterable[QualityRow]) -> QualityTable:
    """Return figures by section; those without a value are left out."""
    rows = tuple(rows)
    known = [row for row in rows if row.value is not None]
    expected = {row.key: row for row in known if row.key in PREDICTED.values()}
    sections: list[QualitySection] = []
    for title, beginnings, steps in SECTIONS:
        starts = tuple(beginnings.split())
        part = tuple(
            (row, expected.get(PREDICTED.get(row.key, "")))
            for row in known
            if row.key not in expected and row.key.startswith(starts)
        )
        left_out = tuple(r for r in rows if r.stale_reason and r.key.startswith(starts))
        if part or left_out:
            sections.append(QualitySection(title, steps, part, left_out))
    return QualityTable(tuple(expected.values()), tuple(sections))
