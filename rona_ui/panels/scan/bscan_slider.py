"""B-scan slider: all A-scans as a grey image with their boundaries; a click selects one."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.app.steps.boundaries.ascan_view import (
    ScanMarks,
    ScanPicture,
    scan_marks,
    scan_picture,
    share_of_scan,
)
from rona_core.geometry.arrays import Floats, Ints
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change
from rona_ui.panels.widgets.graphs import ImageSlider, png_url
from rona_ui.presentation.colors import GREEN, ORANGE, SKY, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot

HEIGHT_PX, WIDTH_PX = 150, 350
FINE = 2  # pixels of the picture for each of the page
LEVELS_DB = (-58.0, -10.0)  # black and white; over a perfect mirror
PARTS = {"Whole path": None, "100 A-scans": 100, "30 A-scans": 30}
DEPTH_MM = 5.0  # from tick to tick
STRIP_PX = 5  # along the bottom: orange where a boundary is missing, blue where it is by hand
LINE_PX = 2  # of a boundary
MOST_MM = 30.0
KEY = (
    (css(GREEN), "outer"),
    (css(VERMILLION), "inner"),
    (css(ORANGE), "flagged"),
    (css(SKY), "by hand"),
)
LEGEND = style.key((("transparent", "Depth of bone in mm"), *KEY)).replace(
    '<i style="background:transparent"></i>', ""
)


class ScanSlider:
    """Depth down, path across. The slider is the image's own track."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        hint = "Echo level along the path. Click to go to an A-scan"
        self._part = gui.add_dropdown("Show", tuple(PARTS), visible=False, hint=hint)
        self._slider = ImageSlider(gui, "r-ascans", "A-scan", HEIGHT_PX, self._chosen)
        self._legend = gui.add_html(LEGEND, visible=False)
        self._drawn: tuple[object, ...] = ()
        self._seen: tuple[Snapshot, int] | None = None
        self._span: tuple[int, int] = (0, 0)
        on_change(self._part, lambda e: self._again())

    def render(self, number: int | None, new: Snapshot) -> None:
        """Draw the image where it is another one, and put the slider at the A-scan."""
        picture = None if number is None else scan_picture(new.session, new.scan)
        shown = picture is not None and len(picture) > 1
        self._part.visible = self._legend.visible = shown
        if picture is None or number is None or not shown:
            self._seen, self._drawn = None, ()
            self._slider.clear()
            return
        self._seen = new, number
        results, span = new.session.results, self._spanned(number, len(picture))
        key = (
            id(picture.image), id(results.detection), id(results.second_detection),
            id(results.sono_detection), id(new.session.boundary_edits), span,
        )  # fmt: skip
        if key != self._drawn:
            self._build(picture, scan_marks(new.session, new.scan), span, number)
            self._drawn, self._span = key, span
        self._slider.value = number

    def _again(self) -> None:
        self._span = (0, 0)
        if self._seen is not None:
            new, number = self._seen
            self.render(number, new)

    def _spanned(self, number: int, n: int) -> tuple[int, int]:
        """Return the first and the last A-scan of the part that is shown."""
        wanted = PARTS[self._part.value]
        if wanted is None or wanted >= n:
            return 0, n - 1
        first, last = self._span
        if last - first == wanted - 1 and first <= number <= last < n:
            return self._span
        first = int(np.clip(number - wanted // 2, 0, n - wanted))
        return first, first + wanted - 1

    def _build(
        self, picture: ScanPicture, marks: ScanMarks | None, span: tuple[int, int], number: int
    ) -> None:
        columns = np.linspace(span[0], span[1], WIDTH_PX * FINE).round().astype(np.int64)
        inset = np.array((0.06, 0.35, 0.65, 0.93))  # a label at the edge would be cut off
        places = np.unique((span[0] + inset * (span[1] - span[0])).round().astype(int))
        ends = tuple((int(i), f"{picture.path_mm[i]:.0f} mm") for i in places)
        self._slider.show(bscan_svg(picture, marks, columns), span, number, ends)

    def _chosen(self, event: Any) -> None:
        if self._seen is None:
            return
        new, number = self._seen[0], event.target.value
        share = share_of_scan(new.session, int(number), new.scan)
        if new.scan == "hand":
            self._context.set_view(handheld_cursor=share or 0.0, dragged_boundary=None)
        else:
            self._context.set_view(cursor=share, playing=False, dragged_boundary=None)


def _rows(picture: ScanPicture, times_us: Floats, height: int) -> Ints:
    """Return the row of the picture for each time; outside of it beyond its edges."""
    first, last = float(picture.image.time_us[0]), float(picture.image.time_us[-1])
    return np.floor((times_us - first) / (last - first) * height).astype(np.int64)


def bscan_svg(picture: ScanPicture, marks: ScanMarks | None, columns: Ints) -> str:
    """Return the image of the A-scans with these numbers (w,), with depths along its left edge."""
    url = png_url(scan_pixels(picture, marks, columns))
    depths = "" if marks is None else _depths_svg(picture, marks)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" '
        f'preserveAspectRatio="none"><image width="{WIDTH_PX}" height="{HEIGHT_PX}" '
        f'preserveAspectRatio="none" href="{url}"/>{depths}</svg>'
    )


def _depths_svg(picture: ScanPicture, marks: ScanMarks) -> str:
    """Return numbers and ticks of the depth of bone (mm), counted from the outer boundary."""
    found = marks.outer_us[marks.outer_ok]
    zero_us = float(np.median(found)) if len(found) else float(picture.image.time_us[0])
    depths_mm = np.arange(0.0, MOST_MM, DEPTH_MM)
    rows = _rows(picture, zero_us + 2.0 * depths_mm / marks.sound_speed_mm_per_us, HEIGHT_PX)
    return "".join(
        f'<text x="3" y="{y + 3.5}" font-family="sans-serif" font-size="10" font-weight="bold" '
        f'fill="#fff" stroke="#000" stroke-width="2" paint-order="stroke">{depth_mm:.0f} –</text>'
        for depth_mm, y in zip(depths_mm, rows.tolist(), strict=True)
        if 4 <= y < HEIGHT_PX - STRIP_PX - 4
    )


def scan_pixels(picture: ScanPicture, marks: ScanMarks | None, columns: Ints) -> NDArray[np.uint8]:
    """Return the image (h, w, 3) of the A-scans with these numbers (w,)."""
    height, strip = HEIGHT_PX * FINE, STRIP_PX * FINE
    times = picture.image.time_us
    rows = np.linspace(0, len(times) - 1, height).round().astype(np.int64)
    low, high = LEVELS_DB
    share = (picture.image.level_db[np.ix_(rows, columns)] - low) / (high - low)
    grey = np.round(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)
    image = np.repeat(grey[:, :, None], 3, axis=2)
    if marks is None:
        return image
    across = np.arange(len(columns))
    for name, color in (("outer", GREEN), ("inner", VERMILLION)):
        ok = getattr(marks, f"{name}_ok")[columns]
        at = _rows(picture, getattr(marks, f"{name}_us")[columns], height)
        for line in range(LINE_PX * FINE):
            inside = ok & (at + line >= 0) & (at + line < height - strip)
            image[(at + line)[inside], across[inside]] = color
    image[-strip:] = 0
    image[-strip:, marks.flagged[columns]] = ORANGE
    image[-strip:, marks.by_hand[columns]] = SKY
    return image
