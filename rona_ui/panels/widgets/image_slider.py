"""A slider whose track is a picture: a click in the picture chooses the place."""

import base64
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

SHEET = """<style>
div:has(>.%(name)s)+div{padding:0 14px 26px!important;overflow:hidden}
div:has(>.%(name)s)+div .mantine-Slider-root{padding:0!important;height:%(h)dpx}
div:has(>.%(name)s)+div .mantine-Slider-trackContainer{height:%(h)dpx}
div:has(>.%(name)s)+div .mantine-Slider-track{height:%(h)dpx;border-radius:3px;
 background:url(data:%(kind)s;base64,%(data)s) 0 0/100%% 100%% no-repeat;image-rendering:pixelated}
div:has(>.%(name)s)+div .mantine-Slider-track::before{display:none}
div:has(>.%(name)s)+div .mantine-Slider-bar{background:transparent!important}
div:has(>.%(name)s)+div .mantine-Slider-thumb{height:%(h)dpx!important;width:5px!important;
 border-radius:2px;background:#fff!important;border:1px solid #1f2933;box-sizing:border-box}
div:has(>.%(name)s)+div .mantine-Slider-mark{visibility:hidden}
div:has(>.%(name)s)+div .mantine-Slider-markWrapper{top:%(mark)dpx}
div:has(>.%(name)s)+div .mantine-Slider-markLabel{font-size:11px!important;color:#3e4c59}
div:has(>.%(name)s)+div .mantine-NumberInput-root{display:none}
div:has(>.%(name)s)+div div:has(>p){display:none}
</style><div class="%(name)s"></div>"""


def sheet(name: str, height_px: int, kind: str, image: bytes) -> str:
    """Return the style of the slider that is added next; the picture fills its track.

    Args:
        name: CSS class that no other slider has.
        height_px: Height of the picture.
        kind: Media type of the picture, as ``image/png``.
        image: Its bytes.
    """
    data = base64.b64encode(image).decode()
    return SHEET % {
        "name": name,
        "h": height_px,
        "mark": height_px + 2,
        "kind": kind,
        "data": data,
    }


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
