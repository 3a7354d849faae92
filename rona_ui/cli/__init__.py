"""The command line: serve, demo, study, inspect, report, figures, export, compare and others."""

import argparse
import gc
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rona_core import __version__
from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.robots import ROBOTS
from rona_core.errors import RonaError, storage_error

INTERPOLATIONS = ("linear", "cubic", "quintic")
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
DESCRIPTION = (
    "Plan, rehearse and evaluate a robot-held 3D ultrasound scan of the skull. "
    "Research software, not a medical device."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit status: 0 done, 2 bad input, 3 could not be finished."""
    wanted = _parser().parse_args(arguments)
    try:
        return _command(wanted.verb).run(wanted)
    except RonaError as error:
        return _complain(str(error), BAD_INPUT)
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        return _complain(str(storage_error(error)), BAD_INPUT)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except Exception as error:  # a defect: one line, unless more is wanted
        if os.environ.get("RONA_DEBUG"):
            traceback.print_exc()
        text = f"{type(error).__name__}: {error} (a defect; RONA_DEBUG=1 shows where)"
        return _complain(text, FAILED)


def _command(verb: str) -> Any:
    """Import a command; only what it needs, so that --help answers at once.

    What is imported stays: to search it for garbage meanwhile would take a tenth of the start.
    """
    gc.disable()
    command = import_module(f"rona_ui.cli.{verb}")
    gc.freeze()
    gc.enable()
    return command


def _complain(text: str, status: int) -> int:
    sys.stderr.write(f"error: {' '.join(text.split())}\n")
    return status


# ------------------------------------------------------------------ arguments


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="rona", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"rona {__version__}")
    verbs = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_serve(verbs)
    _add_demo(verbs)
    _add_study(verbs)
    _add_inspect(verbs)
    _add_report(verbs)
    _add_figures(verbs)
    _add_export(verbs)
    _add_compare(verbs)
    _add_recover(verbs)
    _add_calibrate(verbs)
    _add_detect(verbs)
    _add_verify(verbs)
    return parser


def _verb(verbs: Any, name: str, text: str, more: str = "") -> argparse.ArgumentParser:
    """Add a command; its description is ``text`` as a sentence, and ``more``."""
    verb: argparse.ArgumentParser = verbs.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}. {more}".rstrip()
    )
    verb.set_defaults(verb=name)
    return verb


def _add_serve(verbs: Any) -> None:
    verb = _verb(verbs, "serve", "start the program for the browser")
    verb.add_argument(
        "file",
        type=Path,
        nargs="?",
        metavar="FILE",
        help="session to open: a file of the sessions folder, or a copy of another one",
    )
    verb.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: this machine only)"
    )
    verb.add_argument("--port", type=int, default=8642, help="port, 0 for a free one (8642)")
    verb.add_argument("--sessions", type=Path, metavar="DIR", help="folder of session files")
    verb.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="a further name that the server answers to; may be repeated",
    )
    verb.add_argument(
        "--root-path",
        default="",
        metavar="PATH",
        help="sub path that a reverse proxy serves it under, such as /rona",
    )
    verb.add_argument(
        "--no-auth",
        action="store_true",
        help="no token; only when listening on this machine (else RONA_TOKEN or a random one)",
    )
    verb.add_argument("--no-open", action="store_true", help="do not open a browser")
    verb.add_argument(
        "--pace",
        type=float,
        metavar="X",
        help="show captures at X times real time (default: 8); 0 for at once",
        default=8.0,
    )


def _add_demo(verbs: Any) -> None:
    more = "Exit status: 0 done, 2 bad input, 3 without maps or without an implant bed."
    verb = _verb(verbs, "demo", "carry out the complete procedure without a browser", more)
    verb.add_argument("--seed", type=int, default=0, help="patient, placement and noise (0)")
    verb.add_argument(
        "--specimen",
        default="simulated",
        metavar="simulated|FILE",
        help="simulated skull, or a file: mask or CT volume (.nrrd, .nii), mesh (.stl, .ply, .obj)",
    )
    verb.add_argument("--inner", metavar="FILE", help="inner surface, where it is another file")
    verb.add_argument(
        "--threshold", type=float, metavar="V", help="bone threshold of a CT, in its own units"
    )
    text = "value of bone in a map of several labels"
    verb.add_argument("--label", type=int, metavar="N", help=text)
    verb.add_argument(
        "--center",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="centre of the scanned region in mm, in coordinates of the specimen",
    )
    verb.add_argument("--radius", type=float, metavar="R", help="radius of the region in mm (25)")
    text = "what patient and devices really are: nominal, realistic or hard (realistic)"
    verb.add_argument("--world", default="realistic", metavar="NAME", help=text)
    first, *others = ROBOTS
    text = f"robot: {first} (default), {', '.join(others)}"
    verb.add_argument("--robot", default=first, metavar="NAME", help=text)
    first, *others = PROBE_DATA
    text = f"probe: {first} (default), {', '.join(others)}"
    verb.add_argument("--probe", default=first, metavar="NAME", help=text)
    text = "leave out a stage that need not be, e.g. caliper or tilts; may be repeated"
    verb.add_argument("--skip", action="append", default=[], metavar="STAGE", help=text)
    verb.add_argument("--out", type=Path, metavar="FILE", help="save the session here")
    verb.add_argument("--json", action="store_true", help="print one JSON object, no table")


def _add_study(verbs: Any) -> None:
    text = "run the procedure on many virtual patients by a plan, and report on them"
    more = (
        "rona study PLAN.toml --out FOLDER runs what has no row yet, so the same command goes on "
        "after an interruption; rona study status FOLDER and rona study report FOLDER read what is "
        "there. Exit status: 0 done, 2 bad input; failed patients are rows."
    )
    verb = _verb(verbs, "study", text, more)
    text = "plan to run (.toml), or: status, report"
    verb.add_argument("what", metavar="PLAN.toml|status|report", help=text)
    text = "folder of the study, for status and report"
    verb.add_argument("folder", type=Path, nargs="?", metavar="FOLDER", help=text)
    text = "folder that the study is written to, or goes on in"
    verb.add_argument("--out", type=Path, metavar="FOLDER", help=text)
    text = "run on the workers of this scheduler of Dask, e.g. tcp://host:8786 (this machine)"
    verb.add_argument("--scheduler", metavar="ADDRESS", help=text)
    text = "how many workers on this machine (as it has cores)"
    verb.add_argument("--workers", type=int, metavar="N", help=text)


def _add_inspect(verbs: Any) -> None:
    verb = _verb(verbs, "inspect", "say what a session file holds")
    verb.add_argument("file", type=Path, metavar="FILE")
    verb.add_argument("--json", action="store_true", help="print one JSON object")


def _add_report(verbs: Any) -> None:
    text = "write a session as one page to print and to keep"
    more = "HTML without scripts: maps, figures with their limits, calibrations, certificate."
    verb = _verb(verbs, "report", text, more)
    verb.add_argument("file", type=Path, metavar="SESSION", help="session file (.rona)")
    text = "page that is written (beside the session, .html)"
    verb.add_argument("out", type=Path, nargs="?", metavar="OUT.html", help=text)


def _add_figures(verbs: Any) -> None:
    text = "draw the paper's figures from a session, for print"
    more = "One column (85 mm) wide; of a figure that cannot be drawn, the step that it needs. "
    more += "Exit status: 0 done, 2 bad input, 3 none could be drawn."
    verb = _verb(verbs, "figures", text, more)
    verb.add_argument("file", type=Path, metavar="SESSION", help="session file (.rona)")
    text = "folder that they are written to (beside the session, NAME_figures)"
    verb.add_argument("--out", type=Path, metavar="DIR", help=text)
    text = "only this one, e.g. joints (a wrong name lists all); may be repeated"
    verb.add_argument("--only", action="append", default=[], metavar="NAME", help=text)
    text = "svg, or png of 600 dots per inch (both)"
    verb.add_argument("--format", choices=("svg", "png"), help=text)


def _add_export(verbs: Any) -> None:
    text = "write what a session holds as files for other programs"
    more = "Places are in base, in mm; the milling path is in the frame of the bed. Without an "
    more += "option all files of the maps. Exit status: 0 done, 2 bad input, 3 none could be made."
    verb = _verb(verbs, "export", text, more)
    verb.add_argument("file", type=Path, metavar="SESSION", help="session file (.rona)")
    verb.add_argument("out", type=Path, metavar="DIR", help="folder that they are written to")
    text = "only this one, e.g. bone.stl or bed_path.csv (a wrong name lists all); may be repeated"
    verb.add_argument("--only", action="append", default=[], metavar="NAME", help=text)
    for kind, text in (
        ("maps", "meshes (PLY, STL, VTP), images (NRRD), markups, a table (CSV)"),
        ("bed", "milling path, milled body, markups"),
        ("volume", "echoes as a volume (NRRD)"),
        ("motion", "certified motions: CSV, JointTrajectory, URScript, MCAP"),
        ("captures", "what the devices recorded (HDF5), and all transforms (JSON, .tfm)"),
    ):
        verb.add_argument(
            f"--{kind}", action="append_const", dest="kinds", const=kind, default=[], help=text
        )


def _add_compare(verbs: Any) -> None:
    text = "compare the maps of a session with a reference"
    more = "Along the normal of the maps; positive where they lie outside, or have more bone."
    verb = _verb(verbs, "compare", text, more)
    verb.add_argument("file", type=Path, metavar="SESSION", help="session file (.rona)")
    text = (
        "mesh (STL, PLY, OBJ, mm; closed: both tables, open: the outer one), mask or CT (NRRD, "
        "NIfTI), or session file"
    )
    verb.add_argument("reference", type=Path, metavar="REFERENCE", help=text)
    text = "lay the reference under the outer map first (default: it is in base)"
    verb.add_argument("--register", choices=("none", "surface"), default="none", help=text)
    text = "value from which a CT is bone, about 300; a mask needs none"
    verb.add_argument("--threshold", type=float, metavar="VALUE", help=text)
    verb.add_argument("--json", action="store_true", help="print one JSON object")


def _add_recover(verbs: Any) -> None:
    text = "list sessions that were not saved when the program ended, or save one of them"
    more = (
        "Those of a program that still runs are not among them. Exit status: 0 done, 2 bad input, "
        "3 saved, but not the whole of it."
    )
    verb = _verb(verbs, "recover", text, more)
    text = "name or key of the session to save, as the list has it"
    verb.add_argument("name", nargs="?", metavar="NAME", help=text)
    verb.add_argument("--out", type=Path, metavar="FILE", help="save it here (its name, .rona)")
    verb.add_argument("--discard", action="store_true", help="remove its copy instead, for good")
    verb.add_argument("--sessions", type=Path, metavar="DIR", help="folder of session files")
    verb.add_argument("--json", action="store_true", help="print one JSON object")


def _add_calibrate(verbs: Any) -> None:
    verb = _verb(verbs, "calibrate", "calibrate from recorded data, without a session")
    kinds = verb.add_subparsers(title="what", required=True, metavar="WHAT")
    text = "find the tip of a tracked tool that was pivoted about it"
    more = "Exit status: 0 done, 2 bad input, 3 refused because the data determine no tip."
    kind = _verb(kinds, "pivot", text, more)
    kind.set_defaults(verb="calibrate", what="pivot")
    kind.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="matrices or position and quaternion (a file each, a folder or zip of them, or a row "
        "each; also .npy, .npz, .mat, .json), frame,marker,x,y,z in mm, .igs.mha, ROS recording",
    )
    kind.add_argument(
        "--geometry",
        type=Path,
        metavar="FILE",
        help="markers of the tool: CSV marker,x,y,z or .rom",
    )
    kind.add_argument("--tool", metavar="NAME", help="which tool of a recording with several")
    _add_layout(kind)
    kind.add_argument("--unit", choices=("mm", "cm", "m"), help="of positions (as named, or mm)")
    kind.add_argument(
        "--dof", type=int, choices=(6, 5), default=6, help="5 for markers on one line (6)"
    )
    kind.add_argument(
        "--method", choices=("ml", "sphere"), default="ml", help="how it is solved (ml)"
    )
    kind.add_argument("--json", action="store_true", help="print one JSON object, no table")
    _add_hand_eye(kinds)


def _add_hand_eye(kinds: Any) -> None:
    text = "find where a tracker or camera is that saw what a robot moved, or was moved by it"
    more = "Exit status: 0 done, 2 bad input, 3 the verdict is bad."
    kind = _verb(kinds, "hand-eye", text, more)
    kind.set_defaults(verb="calibrate", what="hand-eye", tool=None)
    text = "poses of the robot's tool in its base; any file that calibrate pivot reads"
    kind.add_argument("robot_file", type=Path, metavar="A", help=text)
    text = "poses of the marker or board in the sensor (none: the second poses in A)"
    kind.add_argument("sensor_file", type=Path, nargs="?", metavar="B", help=text)
    text = "sensor beside the robot, or on it (eye-to-hand)"
    setups = ("eye-to-hand", "eye-in-hand")
    kind.add_argument("--setup", choices=setups, default=setups[0], help=text)
    text = "errors of an optical tracker, or of a camera, which grow with the distance (tracker)"
    kind.add_argument("--noise", choices=("tracker", "camera"), default="tracker", help=text)
    text = "whose poses are the inverse of what is expected"
    kind.add_argument("--inverse", choices=("robot", "sensor", "both"), help=text)
    for whose in ("robot", "sensor"):
        text = f"which poses are those of the {whose}, where a file has several"
        kind.add_argument(f"--{whose}", metavar="NAME", help=text)
    _add_layout(kind)
    text = "of positions: mm, cm or m, or one each for A and B: m,mm (as named, or mm)"
    kind.add_argument("--unit", metavar="UNIT", help=text)
    text = "draw how far each pose is off (.svg or .png)"
    kind.add_argument("--picture", type=Path, metavar="FILE", help=text)
    kind.add_argument("--json", action="store_true", help="print one JSON object, no table")


def _add_layout(kind: argparse.ArgumentParser) -> None:
    """Add what a person may have to say of files of poses."""
    text = "which frame, where a recording has poses in several (e.g. Reference)"
    kind.add_argument("--frame", metavar="NAME", help=text)
    text = "names of all columns, where the file has none: time,x,y,z,qx,qy,qz,qw or m00,m01,…"
    kind.add_argument("--columns", metavar="NAMES", help=text)
    text = "order of quaternions without names (xyzw after a position, wxyz before one)"
    kind.add_argument("--quaternion", choices=("wxyz", "xyzw"), help=text)


def _add_detect(verbs: Any) -> None:
    text = "measure the thickness of a plate or bone in recorded ultrasound lines"
    more = (
        "Pulse, stand-off and alignment are learned from the lines. Envelopes are timed, no "
        "cycle is counted; the predicted deviation says what that leaves open, up to half a "
        "cycle where echoes were cut off. Swept emissions are flagged. Exit status: 0 done, "
        "2 bad input, 3 no line shows a back wall."
    )
    verb = _verb(verbs, "detect", text, more)
    verb.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="HDF5, .mat or .npz with rf (scans, samples), fs in Hz and, if known, t0 in s and "
        "positions in mm",
    )
    verb.add_argument(
        "--speed", type=float, required=True, metavar="C", help="sound speed in the plate, m/s"
    )
    verb.add_argument(
        "--probe", metavar="NAME", help=f"probe that took them: {', '.join(PROBE_DATA)} (found out)"
    )
    verb.add_argument("--json", action="store_true", help="print one JSON object, no table")


def _add_verify(verbs: Any) -> None:
    text = "verify a motion of a robot that was planned elsewhere"
    more = (
        "Limits, steps, speeds and accelerations of the joints, speed of the tool, collisions; the "
        "robot starts and ends at rest. Exit status: 0 certified, 2 unreadable, 3 refused."
    )
    verb = _verb(verbs, "verify", text, more)
    text = "CSV (time_s, q1_rad ... q6_rad), JointTrajectory (.json, .yaml), URScript (.script), "
    verb.add_argument("file", type=Path, metavar="FILE", help=text + "bag of ROS 2 (.mcap, .db3)")
    text = f"{', '.join(ROBOTS)}, or a description (.urdf) of an arm built like those of UR"
    verb.add_argument("--robot", required=True, metavar="NAME|FILE", help=text)
    text = "what stands around: that of a session file, or self: the robot alone (self)"
    verb.add_argument("--obstacles", default="self", metavar="SESSION|self", help=text)
    text = "what is in the holder of the tool (probe)"
    verb.add_argument("--tool", choices=("probe", "burr"), default="probe", help=text)
    text = "what is driven between samples (as ROS joins what the file states)"
    verb.add_argument("--interpolation", choices=INTERPOLATIONS, help=text)
    text = "fastest that the tool may go in mm/s (250)"
    verb.add_argument("--tool-speed", type=float, default=250.0, metavar="V", help=text)
    text = "also insist on a distance from singular postures, as on a scan path"
    verb.add_argument("--demand", choices=("singular",), help=text)
    verb.add_argument("--topic", metavar="NAME", help="of a bag with several")
    text = "draw the joints with their limits and refused places (.svg or .png)"
    verb.add_argument("--picture", type=Path, metavar="FILE", help=text)
    verb.add_argument("--json", action="store_true", help="print one JSON object, no table")
