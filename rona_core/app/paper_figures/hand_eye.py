"""A hand-eye calibration as a picture: how far each pose is off, and how it turned."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.paper_figures.style import INK, SOFT, Format, figure_file
from rona_core.app.steps.tool.hand_eye_report import HandEyeReport
from rona_core.mapping.colors import BLUE, VERMILLION, css

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
    scatter = (
        (upper, found.left_out_mm, found.shifts_mm, "shift (mm)"),
        (lower, found.left_out_deg, found.turns_deg, "turn (degrees)"),
    )
    kinds = (
        (found.used, BLUE, "by the calibration without it"),
        (~found.used, VERMILLION, "rejected"),
    )
    for axes, left_out, fitted, label in scatter:
        for rows, colour, name in kinds:
            if rows.any():
                axes.bar(report.rows[rows], left_out[rows], color=css(colour), label=name)
        axes.plot(report.rows, fitted, ".", color=INK, markersize=2.0, label="fitted")
        good = left_out[found.used]
        axes.axhline(float(np.sqrt((good**2).mean())), color=SOFT, linewidth=0.5)
        axes.set_ylabel(label)
        axes.set_ylim(0.0, max(1.4 * float(good.max(initial=0.0)), 1e-9))  # gross errors reach out
    upper.set_title(
        f"{found.setup}, {found.noise}: {found.verdict}, expected error {found.sigma_mm:.2g} mm"
    )
    upper.legend(loc="upper right", ncols=3)
    lower.set_xlabel("pose")
