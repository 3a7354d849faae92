"""Writes docs/interoperability.md: each kind of file of poses, and what comes of reading it.

The files are made here, of 40 poses of a pivot whose tip is known, and read as a user's would be.
Recordings of ROS need the extra ``rona[bags]``; their rows stand in the page without being made.
"""

from pathlib import Path

import numpy as np

from rona_core.app.steps.pointer.pivot_report import report_pivot
from rona_core.devices.files.poses.recorded_poses import read_poses
from rona_core.errors import RonaError
from tests.helpers.pivot_data import TIP
from tests.helpers.pose_samples import FILES, QUESTIONS, SAYS, P, file, ndi

PAGE = Path(__file__).resolve().parents[1] / "interoperability.md"
INTRO = """# Interoperability: files of poses

What each kind of file gives, made by `make interoperability` from the same 40 poses of a pivot
(`tests/helpers/pose_samples.py`). *Read*: all poses come back; then the tip's distance from where
it was. How to say what a file leaves open: [import a pivot](how-to/import_a_pivot.md); the same
readers serve [hand-eye calibration](how-to/calibrate_hand_eye.md).

| file | what is in it | result |
|---|---|---|
"""
ROS = (
    "| ROS 2 bag (`.db3`, `.mcap`, folder), ROS 1 `.bag` | stamped poses and transforms, Odometry, "
    "TF | read with `pip install 'rona[bags]'`, metres converted, a tool for each child frame or "
    "topic |\n| MCAP of Foxglove | PoseInFrame, FrameTransform in JSON | the same |\n"
)
OPEN = """
## What is asked or refused

Where the columns allow several readings, nothing is guessed.

| file | answer |
|---|---|
"""


def page() -> str:
    """Return the page."""
    read = [f"| `{name}` | {SAYS[name]} | {_result(name)} |\n" for name in FILES]
    asked = [f"| {name} | {_answer(name)} |\n" for name in QUESTIONS]
    return "".join((INTRO, *read, _ndi_row(), ROS, OPEN, *asked))


def _result(name: str) -> str:
    given = file(name, FILES[name])
    found = read_poses([given])
    (column,) = found.recording.tools
    if len(column.Ts_tracker_marker) != len(P):
        return f"{len(column.Ts_tracker_marker)} of {len(P)} poses"
    tip = report_pivot([given]).calibration.tip_marker
    off = np.inf if tip is None else float(np.linalg.norm(tip - TIP))
    words = [f"read, tip {off:.2f} mm", "with times" if found.clocked else ""]
    words += [note[0].lower() + note[1:].rstrip(".") for note in found.notes if "Pos" in note]
    words.append("" if found.frame is None else f"poses in {found.frame}")
    return ", ".join(word for word in words if word)


def _ndi_row() -> str:
    tools = read_poses([file("ndi.csv", ndi())]).recording.tools
    seen = ", ".join(f"{len(tool.Ts_tracker_marker)} poses" for tool in tools)
    return (
        "| `ndi.csv` | NDI table of two tools with single markers, Windows line ends, states, "
        f"-3.697314E28 where not seen | read, a tool each: {seen}, with times |\n"
    )


def _answer(name: str) -> str:
    try:
        read_poses([file("FILE", QUESTIONS[name][0])])
    except RonaError as error:
        return str(error).replace("|", "\\|")
    return "read"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
