"""The command line: serve, demo, study, inspect, report, figures, export, compare and others."""

import argparse
import gc
import os
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
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

Argument = tuple[tuple[str, ...], dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Verb:
    """A command; its description is ``text`` as a sentence, and ``more``."""

    text: str
    arguments: tuple[Argument, ...]
    more: str = ""
    values: dict[str, Any] = field(default_factory=dict[str, Any])  # that it comes with
    kinds: dict[str, "Verb"] = field(default_factory=dict[str, "Verb"])


def _argument(*names: str, **words: Any) -> Argument:
    return names, words


def _path(name: str, metavar: str, text: str | None = None, **words: Any) -> Argument:
    return _argument(name, type=Path, metavar=metavar, help=text, **words)


def _name(name: str, metavar: str, text: str, **words: Any) -> Argument:
    return _argument(name, metavar=metavar, help=text, **words)


def _choice(name: str, choices: tuple[str, ...], text: str, **words: Any) -> Argument:
    return _argument(name, choices=choices, help=text, **words)


def _switch(name: str, text: str) -> Argument:
    return _argument(name, action="store_true", help=text)


def _several(name: str, metavar: str, text: str) -> Argument:
    return _argument(name, action="append", default=[], metavar=metavar, help=text)


def _exported(kind: str, text: str) -> Argument:
    words = {"action": "append_const", "dest": "kinds", "const": kind, "default": []}
    return _argument(f"--{kind}", help=text, **words)


SESSION = _path("file", "SESSION", "session file (.rona)")
SESSIONS = _path("--sessions", "DIR", "folder of session files")
JSON, JSON_ALONE = (
    _switch("--json", f"print one JSON object{more}") for more in ("", ", no table")
)
LAYOUT = (  # what a person may have to say of files of poses
    _name(
        "--frame", "NAME", "which frame, where a recording has poses in several (e.g. Reference)"
    ),
    _name(
        "--columns",
        "NAMES",
        "names of all columns, where the file has none: time,x,y,z,qx,qy,qz,qw or m00,m01,…",
    ),
    _choice(
        "--quaternion",
        ("wxyz", "xyzw"),
        "order of quaternions without names (xyzw after a position, wxyz before one)",
    ),
)
PIVOT = Verb(
    "find the tip of a tracked tool that was pivoted about it",
    (
        _path(
            "files",
            "FILE",
            "matrices or position and quaternion (a file each, a folder or zip of them, or a row "
            "each; also .npy, .npz, .mat, .json), frame,marker,x,y,z in mm, .igs.mha, ROS "
            "recording",
            nargs="+",
        ),
        _path("--geometry", "FILE", "markers of the tool: CSV marker,x,y,z or .rom"),
        _name("--tool", "NAME", "which tool of a recording with several"),
        *LAYOUT,
        _choice("--unit", ("mm", "cm", "m"), "of positions (as named, or mm)"),
        _argument(
            "--dof", type=int, choices=(6, 5), default=6, help="5 for markers on one line (6)"
        ),
        _choice("--method", ("ml", "sphere"), "how it is solved (ml)", default="ml"),
        JSON_ALONE,
    ),
    "Exit status: 0 done, 2 bad input, 3 refused because the data determine no tip.",
    {"verb": "calibrate", "what": "pivot"},
)
HAND_EYE = Verb(
    "find where a tracker or camera is that saw what a robot moved, or was moved by it",
    (
        _path(
            "robot_file",
            "A",
            "poses of the robot's tool in its base; any file that calibrate pivot reads",
        ),
        _path(
            "sensor_file",
            "B",
            "poses of the marker or board in the sensor (none: the second poses in A)",
            nargs="?",
        ),
        _choice(
            "--setup",
            ("eye-to-hand", "eye-in-hand"),
            "sensor beside the robot, or on it (eye-to-hand)",
            default="eye-to-hand",
        ),
        _choice(
            "--noise",
            ("tracker", "camera"),
            "errors of an optical tracker, or of a camera, which grow with the distance (tracker)",
            default="tracker",
        ),
        _choice(
            "--inverse",
            ("robot", "sensor", "both"),
            "whose poses are the inverse of what is expected",
        ),
        *(
            _name(
                f"--{whose}",
                "NAME",
                f"which poses are those of the {whose}, where a file has several",
            )
            for whose in ("robot", "sensor")
        ),
        *LAYOUT,
        _name(
            "--unit",
            "UNIT",
            "of positions: mm, cm or m, or one each for A and B: m,mm (as named, or mm)",
        ),
        _path("--picture", "FILE", "draw how far each pose is off (.svg or .png)"),
        JSON_ALONE,
    ),
    "Exit status: 0 done, 2 bad input, 3 the verdict is bad.",
    {"verb": "calibrate", "what": "hand-eye", "tool": None},
)
VERBS = {
    "serve": Verb(
        "start the program for the browser",
        (
            _path(
                "file",
                "FILE",
                "session to open: a file of the sessions folder, or a copy of another one",
                nargs="?",
            ),
            _argument(
                "--host",
                default="127.0.0.1",
                help="address to listen on (default: this machine only)",
            ),
            _argument("--port", type=int, default=8642, help="port, 0 for a free one (8642)"),
            SESSIONS,
            _several(
                "--allow-host", "NAME", "a further name that the server answers to; may be repeated"
            ),
            _name(
                "--root-path",
                "PATH",
                "sub path that a reverse proxy serves it under, such as /rona",
                default="",
            ),
            _switch(
                "--no-auth",
                "no token; only when listening on this machine (else RONA_TOKEN or a random one)",
            ),
            _switch("--no-open", "do not open a browser"),
            _name(
                "--pace",
                "X",
                "show captures at X times real time (default: 8); 0 for at once",
                type=float,
                default=8.0,
            ),
        ),
    ),
    "demo": Verb(
        "carry out the complete procedure without a browser",
        (
            _argument("--seed", type=int, default=0, help="patient, placement and noise (0)"),
            _name(
                "--specimen",
                "simulated|FILE",
                "simulated skull, or a file: mask or CT volume (.nrrd, .nii), mesh (.stl, .ply, "
                ".obj)",
                default="simulated",
            ),
            _name("--inner", "FILE", "inner surface, where it is another file"),
            _name("--threshold", "V", "bone threshold of a CT, in its own units", type=float),
            _name("--label", "N", "value of bone in a map of several labels", type=int),
            _argument(
                "--center",
                type=float,
                nargs=3,
                metavar=("X", "Y", "Z"),
                help="centre of the scanned region in mm, in coordinates of the specimen",
            ),
            _name("--radius", "R", "radius of the region in mm (25)", type=float),
            _name(
                "--world",
                "NAME",
                "what patient and devices really are: nominal, realistic or hard (realistic)",
                default="realistic",
            ),
            *(
                _name(
                    f"--{what}",
                    "NAME",
                    f"{what}: {' (default), '.join((names[0], ', '.join(names[1:])))}",
                    default=names[0],
                )
                for what, names in (("robot", (*ROBOTS,)), ("probe", (*PROBE_DATA,)))
            ),
            _several(
                "--skip",
                "STAGE",
                "leave out a stage that need not be, e.g. caliper or tilts; may be repeated",
            ),
            _path("--out", "FILE", "save the session here"),
            JSON_ALONE,
        ),
        "Exit status: 0 done, 2 bad input, 3 without maps or without an implant bed.",
    ),
    "study": Verb(
        "run the procedure on many virtual patients by a plan, and report on them",
        (
            _name("what", "PLAN.toml|status|report", "plan to run (.toml), or: status, report"),
            _path("folder", "FOLDER", "folder of the study, for status and report", nargs="?"),
            _path("--out", "FOLDER", "folder that the study is written to, or goes on in"),
            _name(
                "--scheduler",
                "ADDRESS",
                "run on the workers of this scheduler of Dask, e.g. tcp://host:8786 (this machine)",
            ),
            _name("--workers", "N", "how many workers on this machine (as it has cores)", type=int),
        ),
        "rona study PLAN.toml --out FOLDER runs what has no row yet, so the same command goes on "
        "after an interruption; rona study status FOLDER and rona study report FOLDER read what is "
        "there. Exit status: 0 done, 2 bad input; failed patients are rows.",
    ),
    "inspect": Verb("say what a session file holds", (_path("file", "FILE"), JSON)),
    "report": Verb(
        "write a session as one page to print and to keep",
        (
            SESSION,
            _path("out", "OUT.html", "page that is written (beside the session, .html)", nargs="?"),
        ),
        "HTML without scripts: maps, figures with their limits, calibrations, certificate.",
    ),
    "figures": Verb(
        "draw the paper's figures from a session, for print",
        (
            SESSION,
            _path(
                "--out", "DIR", "folder that they are written to (beside the session, NAME_figures)"
            ),
            _several(
                "--only",
                "NAME",
                "only this one, e.g. joints (a wrong name lists all); may be repeated",
            ),
            _choice("--format", ("svg", "png"), "svg, or png of 600 dots per inch (both)"),
        ),
        "One column (85 mm) wide; of a figure that cannot be drawn, the step that it needs. "
        "Exit status: 0 done, 2 bad input, 3 none could be drawn.",
    ),
    "export": Verb(
        "write what a session holds as files for other programs",
        (
            SESSION,
            _path("out", "DIR", "folder that they are written to"),
            _several(
                "--only",
                "NAME",
                "only this one, e.g. bone.stl or bed_path.csv (a wrong name lists all); may be "
                "repeated",
            ),
            _exported("maps", "meshes (PLY, STL, VTP), images (NRRD), markups, a table (CSV)"),
            _exported("bed", "milling path, milled body, markups"),
            _exported("volume", "echoes as a volume (NRRD)"),
            _exported("motion", "certified motions: CSV, JointTrajectory, URScript, MCAP"),
            _exported(
                "captures", "what the devices recorded (HDF5), and all transforms (JSON, .tfm)"
            ),
        ),
        "Places are in base, in mm; the milling path is in the frame of the bed. Without an "
        "option all files of the maps. Exit status: 0 done, 2 bad input, 3 none could be made.",
    ),
    "compare": Verb(
        "compare the maps of a session with a reference",
        (
            SESSION,
            _path(
                "reference",
                "REFERENCE",
                "mesh (STL, PLY, OBJ, mm; closed: both tables, open: the outer one), mask or CT "
                "(NRRD, NIfTI), or session file",
            ),
            _choice(
                "--register",
                ("none", "surface"),
                "lay the reference under the outer map first (default: it is in base)",
                default="none",
            ),
            _name(
                "--threshold",
                "VALUE",
                "value from which a CT is bone, about 300; a mask needs none",
                type=float,
            ),
            JSON,
        ),
        "Along the normal of the maps; positive where they lie outside, or have more bone.",
    ),
    "recover": Verb(
        "list sessions that were not saved when the program ended, or save one of them",
        (
            _name(
                "name", "NAME", "name or key of the session to save, as the list has it", nargs="?"
            ),
            _path("--out", "FILE", "save it here (its name, .rona)"),
            _switch("--discard", "remove its copy instead, for good"),
            SESSIONS,
            JSON,
        ),
        "Those of a program that still runs are not among them. Exit status: 0 done, 2 bad input, "
        "3 saved, but not the whole of it.",
    ),
    "calibrate": Verb(
        "calibrate from recorded data, without a session",
        (),
        kinds={"pivot": PIVOT, "hand-eye": HAND_EYE},
    ),
    "detect": Verb(
        "measure the thickness of a plate or bone in recorded ultrasound lines",
        (
            _path(
                "file",
                "FILE",
                "HDF5, .mat or .npz with rf (scans, samples), fs in Hz and, if known, t0 in s and "
                "positions in mm",
            ),
            _name("--speed", "C", "sound speed in the plate, m/s", type=float, required=True),
            _name("--probe", "NAME", f"probe that took them: {', '.join(PROBE_DATA)} (found out)"),
            JSON_ALONE,
        ),
        "Pulse, stand-off and alignment are learned from the lines. Envelopes are timed, no "
        "cycle is counted; the predicted deviation says what that leaves open, up to half a "
        "cycle where echoes were cut off. Swept emissions are flagged. Exit status: 0 done, "
        "2 bad input, 3 no line shows a back wall.",
    ),
    "verify": Verb(
        "verify a motion of a robot that was planned elsewhere",
        (
            _path(
                "file",
                "FILE",
                "CSV (time_s, q1_rad ... q6_rad), JointTrajectory (.json, .yaml), URScript "
                "(.script), bag of ROS 2 (.mcap, .db3)",
            ),
            _name(
                "--robot",
                "NAME|FILE",
                f"{', '.join(ROBOTS)}, or a description (.urdf) of an arm built like those of UR",
                required=True,
            ),
            _name(
                "--obstacles",
                "SESSION|self",
                "what stands around: that of a session file, or self: the robot alone (self)",
                default="self",
            ),
            _choice(
                "--tool",
                ("probe", "burr"),
                "what is in the holder of the tool (probe)",
                default="probe",
            ),
            _choice(
                "--interpolation",
                INTERPOLATIONS,
                "what is driven between samples (as ROS joins what the file states)",
            ),
            _name(
                "--tool-speed",
                "V",
                "fastest that the tool may go in mm/s (250)",
                type=float,
                default=250.0,
            ),
            _choice(
                "--demand",
                ("singular",),
                "also insist on a distance from singular postures, as on a scan path",
            ),
            _name("--topic", "NAME", "of a bag with several"),
            _path(
                "--picture",
                "FILE",
                "draw the joints with their limits and refused places (.svg or .png)",
            ),
            JSON_ALONE,
        ),
        "Limits, steps, speeds and accelerations of the joints, speed of the tool, collisions; the "
        "robot starts and ends at rest. Exit status: 0 certified, 2 unreadable, 3 refused.",
    ),
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="rona", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"rona {__version__}")
    _add(parser.add_subparsers(title="commands", required=True, metavar="COMMAND"), VERBS)
    return parser


def _add(parsers: Any, verbs: dict[str, Verb]) -> None:
    for name, verb in verbs.items():
        said = f"{verb.text[0].upper()}{verb.text[1:]}. {verb.more}".rstrip()
        parser: argparse.ArgumentParser = parsers.add_parser(name, help=verb.text, description=said)
        parser.set_defaults(**{"verb": name, **verb.values})
        for names, words in verb.arguments:
            parser.add_argument(*names, **words)
        if verb.kinds:
            _add(parser.add_subparsers(title="what", required=True, metavar="WHAT"), verb.kinds)
