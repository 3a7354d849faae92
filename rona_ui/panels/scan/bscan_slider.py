"""B-scan slider: all A-scans as a grey image with their boundaries; a click selects one."""

from dataclasses import replace
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
from rona_ui.panels.widgets.image_slider import png, sheet
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
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
DOT = 3  # pixels of the picture for each of a digit
DIGITS = tuple(
    tuple(rows.split())
    for rows in (
        "### #.# #.# #.# ###", ".#. ##. .#. .#. ###", "### ..# ### #.. ###",
        "### ..# ### ..# ###", "#.# #.# ### ..# ..#", "### #.. ### ..# ###",
        "### #.. ### #.# ###", "### ..# ..# ..# ..#", "### #.# ### #.# ###",
        "### #.# ### ..# ###",
    )
)  # fmt: skip
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
        self._gui, self._context = gui, context
        self._part = gui.add_dropdown(
            "Show",
            tuple(PARTS),
            visible=False,
            hint="Echo level along the path. Click to go to an A-scan",
        )
        self._sheet = gui.add_html("")
        self._folder = gui.add_folder(None, visible=False)
        self._legend = gui.add_html(LEGEND, visible=False)
        self._slider: Any = None
        self._drawn: tuple[object, ...] = ()
        self._seen: tuple[Snapshot, int] | None = None
        self._span: tuple[int, int] = (0, 0)
        on_change(self._part, lambda e: self._again())

    def render(self, number: int | None, new: Snapshot) -> None:
        """Draw the image where it is another one, and put the slider at the A-scan."""
        scan = new.scan
        picture = None if number is None else scan_picture(new.session, scan)
        shown = picture is not None and len(picture) > 1
        for part in (self._part, self._folder, self._legend):
            part.visible = shown
        if picture is None or number is None or not shown:
            self._seen = None
            self._sheet.content = ""
            return
        self._seen = new, number
        session = new.session
        span = self._spanned(number, len(picture))
        key = (
            id(picture.image), id(session.results.detection), id(session.results.second_detection),
            id(session.results.sono_detection), id(session.boundary_edits), span,
        )  # fmt: skip
        if key != self._drawn:
            self._build(picture, scan_marks(session, scan), span, number)
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
        if self._slider is not None:
            self._slider.remove()
        columns = np.linspace(span[0], span[1], WIDTH_PX * FINE).round().astype(np.int64)
        image = png(scan_pixels(picture, marks, columns))
        style_of_track = sheet("r-ascans", HEIGHT_PX, "image/png", image)
        style_of_track = style_of_track.replace("image-rendering:pixelated", "image-rendering:auto")
        inset = np.array((0.06, 0.35, 0.65, 0.93))  # a label at the edge would be cut off
        places = np.unique((span[0] + inset * (span[1] - span[0])).round().astype(int))
        ends = tuple((int(i), f"{picture.path_mm[i]:.0f} mm") for i in places)
        with self._folder:
            self._sheet.remove()
            self._sheet = self._gui.add_html(style_of_track)
            self._slider = self._gui.add_slider("A-scan", span[0], span[1], 1, number, marks=ends)
        on_change(self._slider, self._chosen)

    def _chosen(self, event: Any) -> None:
        if self._seen is None:
            return
        new, number = self._seen[0], int(self._slider.value)
        share = share_of_scan(new.session, number, new.scan)
        if new.scan == "hand":
            self._context.change_view(
                lambda v: replace(v, handheld_cursor=share or 0.0, dragged_boundary=None)
            )
        else:
            self._context.change_view(
                lambda v: replace(v, cursor=share, playing=False, dragged_boundary=None)
            )


def _front_us(picture: ScanPicture, marks: ScanMarks) -> tuple[float, float]:
    """Return the time that is depth 0, and the speed of sound that depth is counted with."""
    if not marks.outer_ok.any():
        return float(picture.image.time_us[0]), marks.sound_speed_mm_per_us
    return float(np.median(marks.outer_us[marks.outer_ok])), marks.sound_speed_mm_per_us


def _rows(picture: ScanPicture, times_us: Floats, height: int) -> Ints:
    """Return the row of the picture for each time; outside of it beyond its edges."""
    first, last = float(picture.image.time_us[0]), float(picture.image.time_us[-1])
    return np.floor((times_us - first) / (last - first) * height).astype(np.int64)


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
    _write_depths(image, picture, marks)
    image[-strip:] = 0
    image[-strip:, marks.flagged[columns]] = ORANGE
    image[-strip:, marks.by_hand[columns]] = SKY
    return image


def _write_depths(image: NDArray[np.uint8], picture: ScanPicture, marks: ScanMarks) -> None:
    """Write ticks and numbers of the depth (mm) along the left edge of the image."""
    zero_us, speed = _front_us(picture, marks)
    depths = np.arange(0.0, MOST_MM, DEPTH_MM)
    rows = _rows(picture, zero_us + 2.0 * depths / speed, len(image))
    for depth_mm, row in zip(depths, rows, strict=True):
        top = int(row) - 5 * DOT // 2
        if top < 0 or top + 5 * DOT > len(image) - STRIP_PX * FINE:
            continue
        digits = f"{depth_mm:.0f}"
        tick = (3 + 4 * len(digits)) * DOT  # behind the number: before it, it would be a minus
        image[row : row + FINE, tick : tick + 3 * DOT] = 255
        for place, digit in enumerate(digits):
            left = (2 + 4 * place) * DOT
            glyph = np.array([[c == "#" for c in line] for line in DIGITS[int(digit)]])
            cell = image[top - DOT : top + 6 * DOT, left - DOT : left + 4 * DOT]
            cell[:] = cell // 3
            inner = image[top : top + 5 * DOT, left : left + 3 * DOT]
            inner[np.kron(glyph, np.ones((DOT, DOT), dtype=np.bool_))] = 255
