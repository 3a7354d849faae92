"""A hand-eye calibration as a picture: how far each pose is off, and how it turned."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.paper_figures.style import INK, SOFT, Format, figure_file
from rona_core.app.steps.tool.hand_eye_report import HandEyeReport
from rona_core.mapping.colors import CATEGORIES, VERMILLION, css

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT_MM = 78.0


def hand_eye_picture(report: HandEyeReport, form: Format) -> bytes:
    """Return the residuals of all poses as SVG or PNG, one column wide."""
    return figure_file(lambda figure: draw_hand_eye(report, figure), HEIGHT_MM, form)


def draw_hand_eye(report: HandEyeReport, figure: "Figure") -> None:
    """Draw how far each pose is off by the calibration without it, in mm and degrees."""
    found = report.calibration
    upper, lower = figure.subplots(2, 1, sharex=True)
    colours = np.where(found.used, css(CATEGORIES[0]), css(VERMILLION))
    scatter = (
        (upper, found.left_out_mm, found.shifts_mm, "shift (mm)"),
        (lower, found.left_out_deg, found.turns_deg, "turn (degrees)"),
    )
    for axes, left_out, fitted, label in scatter:
        axes.bar(report.rows, left_out, color=colours, width=0.8, label="without this pose")
        axes.plot(report.rows, fitted, ".", color=INK, markersize=2.0, label="with it")
        rms = float(np.sqrt((left_out[found.used] ** 2).mean()))
        axes.axhline(rms, color=SOFT, linewidth=0.5)
        axes.set_ylabel(label)
        good = left_out[found.used]
        axes.set_ylim(0.0, max(1.3 * float(good.max(initial=0.0)), 1e-9))  # gross errors reach out
    upper.set_title(
        f"{found.setup}, {found.noise}: {found.verdict}, expected error {found.sigma_mm:.2g} mm; "
        f"{int((~found.used).sum())} of {len(found.used)} rejected (red)"
    )
    upper.legend(loc="upper right")
    lower.set_xlabel("pose")
