"""All rolls at a glance: a map of path by roll, which is also the slider that chooses one."""

import struct
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.app.messages import ChooseRoll
from rona_core.app.views import RollStrip, joint_curves, roll_strip, shown_roll
from rona_ui.panels import style
from rona_ui.panels.door import Door, follow
from rona_ui.panels.picture_slider import sheet
from rona_ui.scene.colors import VERMILLION, css, viridis, viridis_css
from rona_ui.view_state import Picture

PALE = (176, 184, 192)  # of a place that can be reached with a roll that fails elsewhere
HEIGHT_PX = 170


class RollsPanel:
    """Click in the map: the roll is shown; one that works is planned and verified at once."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._gui, self._door = gui, door
        self._words = gui.add_html(style.text("The map of rolls appears after step 7."))
        self._sheet = gui.add_html("")
        self._folder = gui.add_folder(None)
        self._slider: Any = None
        self._remark = gui.add_html("")
        self._works: tuple[bool, ...] = ()

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow search and shown roll."""
        roll = new.session.results.roll
        before = None if old is None else old.session.results.roll
        if old is None or before is not roll:
            self._build(new)
        elif old.view.shown_roll == new.view.shown_roll and old.steps is new.steps:
            return
        index = shown_roll(new.session, new.view.shown_roll)
        if index is not None and self._slider is not None:
            self._slider.value = index
        self._remark.content = remark(new)

    def _build(self, new: Picture) -> None:
        strip = roll_strip(new.session)
        if self._slider is not None:
            self._slider.remove()
            self._slider = None
        if strip is None or len(strip.rolls_deg) < 2:
            self._sheet.content = ""
            self._words.content = style.text("The map of rolls appears after step 7.")
            return
        self._works = tuple(bool(works) for works in strip.feasible)
        self._words.content = style.text(
            "Across: roll. Down: along the path. Click to look at a roll; one that works is "
            "planned and verified. Room: how far the robot stays from joint limits, "
            "singularities, jumps and the end of its reach; 1 is comfortable."
        ) + _legend(_top(strip))
        with self._folder:
            self._sheet.remove()
            image = png(roll_image(strip))
            self._sheet = self._gui.add_html(sheet("r-rolls", HEIGHT_PX, "image/png", image))
            last = len(strip.rolls_deg) - 1
            marks = tuple(
                (i, f"{strip.rolls_deg[i]:.0f}°")
                for i in np.unique(np.linspace(0, last, 5).round().astype(int)).tolist()
            )
            self._slider = self._gui.add_slider(
                "Roll", 0, last, 1, max(strip.chosen, 0), marks=marks
            )
        follow(self._slider, self._chosen)

    def _chosen(self, event: Any) -> None:
        index = int(self._slider.value)
        self._door.view(lambda v: replace(v, shown_roll=index))
        if 0 <= index < len(self._works) and self._works[index]:
            self._door.send_settled("roll", lambda: ChooseRoll(index), event)


def remark(picture: Picture) -> str:
    """Return what there is to say about the shown roll."""
    curves = joint_curves(picture.session, picture.view.shown_roll)
    if curves is None:
        return ""
    words = curves.sentence[:1].upper() + curves.sentence[1:]
    if picture.step("roll").state == "stale":
        return style.note(f"{words}. Stale: search the roll again.", "warn")
    return style.note(words, "good" if curves.feasible else "warn")


def _legend(top: float) -> str:
    entries = (
        (css(VERMILLION), "", "fails here"),
        (css(PALE), "", "fails elsewhere on the path"),
        (viridis_css(), "width:44px;", f"room, 0 to {top:.1f}"),
    )
    spans = "".join(
        f'<span><i style="{size}background:{color}"></i>{words}</span>'
        for color, size, words in entries
    )
    return f'<div class="r-key">{spans}</div>'


def _top(strip: RollStrip) -> float:
    """Return the most room of all rolls, where the colours end."""
    return max(float(strip.room.max(initial=0.0)), 1e-9)


def roll_image(strip: RollStrip) -> NDArray[np.uint8]:
    """Return the colours of all rolls, (places, rolls, 3): path down, rolls across."""
    room = strip.room.T
    image = viridis(np.clip(room / _top(strip), 0.0, 1.0))
    image[:, ~strip.feasible] = PALE
    image[room < 0.0] = VERMILLION
    return image


def png(image: NDArray[np.uint8]) -> bytes:
    """Return an image (h, w, 3) as a PNG file."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)

    height, width = image.shape[:2]
    rows = np.concatenate((np.zeros((height, 1), np.uint8), image.reshape(height, -1)), axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows.tobytes()))
        + chunk(b"IEND", b"")
    )
