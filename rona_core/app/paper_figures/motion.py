"""Joint angles of a motion over time, with their limits and the places that are refused."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.overview.motion_report import MotionReport
from rona_core.app.paper_figures.style import INK, Format, figure_file, open_frame
from rona_core.mapping.colors import CATEGORIES, VERMILLION, css

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT_MM = 120.0


def motion_picture(report: MotionReport, form: Format) -> bytes:
    """Return the graphs of the six joints as a file, one column wide."""
    return figure_file(lambda figure: _draw(report, figure), HEIGHT_MM, form)


def _draw(report: MotionReport, figure: "Figure") -> None:
    way, limits, refused = report.verdict.driven, report.model.limits, report.verdict.refused()
    rows = figure.subplots(6, 1, sharex=True)
    for number, (axes, color) in enumerate(zip(rows, CATEGORIES, strict=True), start=1):
        degrees = np.rad2deg(way.qs_rad[:, number - 1])
        axes.plot(way.times_s, degrees, color=css(color))
        axes.set_ylabel(f"J{number} (°)")
        low, high = axes.get_ylim()
        for limit in np.rad2deg((limits.lower_rad[number - 1], limits.upper_rad[number - 1])):
            axes.axhline(limit, color=INK, linestyle=":", linewidth=0.6)
        axes.set_ylim(low, high)
        for one in refused:
            if one.joint in (None, number):
                axes.axvline(one.time_s, color=css(VERMILLION), linewidth=0.7)
        open_frame(axes)
    names = "; ".join(dict.fromkeys(one.check.name for one in refused))
    verdict = "certified" if report.certified else f"refused: {names}"
    rows[0].set_title(f"{report.model.name}: {verdict}", wrap=True)
    rows[-1].set_xlabel("time (s)")
