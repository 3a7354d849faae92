"""Imports: what was recorded, measured or planned elsewhere becomes the captures of its steps."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import setup_of_import
from rona_core.app.messages.message import StoreCapture
from rona_core.app.steps.acoustics.messages import CalibrateDelayLine
from rona_core.app.steps.implant.burr.messages import RegisterBurr
from rona_core.app.steps.imports.messages import StartImport
from rona_core.app.steps.path.messages import BuildPath, TakePathPoints
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.roll.messages import TakeMotion
from rona_core.app.steps.scan.landmarks.messages import VerifyLandmarks
from rona_core.app.steps.scan.messages import CalibrateProbeMounting
from rona_core.app.steps.surface.messages import BuildSurface, TakeCloud
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.devices.files.arrays import read_hdf5_tree
from rona_core.devices.files.point_files import read_points
from rona_core.devices.files.reader_process import Found
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.geometry.arrays import readonly
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.formats import read_motion
from rona_core.robot.verification.joint_motion import driven, require_places
from rona_core.session.capture_files import FORMAT, capture_from
from rona_core.session.captures import Capture, MotionCapture, PointsCapture, imported_digest
from rona_core.session.document import Captures, Session

MOST_PLACES = 30_000  # of an imported motion
POINTS = {"cloud": ("cloud", TakeCloud), "path": ("path_points", TakePathPoints)}
# capture -> what follows, and which other captures (or results of this name) that needs
FOLLOWS: dict[str, tuple[type, tuple[str, ...]]] = {
    "tool": (RegisterTool, ()),
    "pointer": (CalibratePointer, ()),
    "surface": (BuildSurface, ("tool", "pointer")),
    "cloud": (TakeCloud, ()),
    "path": (BuildPath, ("tool", "pointer")),
    "path_points": (TakePathPoints, ()),
    "robot_motion": (TakeMotion, ("smoothing",)),
    "block": (CalibrateDelayLine, ()),
    "gauge": (CalibrateProbeMounting, ()),
    "landmarks": (VerifyLandmarks, ("tool", "pointer")),
    "burr": (RegisterBurr, ("tool",)),
}


def perform_import(
    activity: StartImport, session: Session, context: ActivityContext
) -> Iterable[Message]:
    """Carry out `StartImport`.

    Raises:
        NotFoundError: the file was not uploaded.
        InvalidInputError: it is damaged, of another kind, or of another robot, pointer or probe
            than those of the set-up; it says which.
    """
    path = context.uploads / activity.file
    if not path.is_file():
        raise NotFoundError(f"there is no uploaded file {activity.file!r}: upload it first")
    file = NamedFile(activity.file, read_file(path, "an uploaded file"))
    if activity.purpose == "captures":
        return _captures(file, activity.only, session)
    if activity.purpose == "motion":
        return _motion(file, session)
    name, follows = POINTS[activity.purpose]
    ordinal, taken_from = len(session.archive) + 1, imported_digest([file.data])
    taken = PointsCapture(ordinal, taken_from, read_points(file))
    return (StoreCapture(name, taken, file=file.name), follows())


def _motion(file: NamedFile, session: Session) -> tuple[Message, ...]:
    """Return messages that store a motion as it is driven, and hold it against the path."""
    motion = read_motion(file, robot_model(session.setup.devices.robot.model))
    require_places(motion, motion.stated(), MOST_PLACES)
    if not bool((np.diff(motion.times_s) > 0.0).all()):
        raise InvalidInputError(f"{file.name}: times must grow: `rona verify` says where")
    way = driven(motion, motion.stated())
    taken = MotionCapture(0, "", readonly(way.times_s), readonly(way.qs_rad))
    marked = _marked(taken, len(session.archive) + 1, file, session)
    return (StoreCapture("robot_motion", marked, file=file.name), TakeMotion())


def _captures(file: NamedFile, only: tuple[str, ...], session: Session) -> list[Message]:
    """Return messages that store the captures of a file, and those that follow."""
    arrays = read_hdf5_tree(file)
    if _text(arrays, "@format") != FORMAT and not only:
        raise InvalidInputError(
            f"{file.name} is no file of captures that RONA has written: name those that are meant "
            "with `only`, such as scan"
        )
    _require_same_devices(file.name, arrays, session)
    stored: list[Message] = []
    taken: list[str] = []
    for name in REGISTRY.captures:
        if only and name not in only:
            continue
        held = capture_from(name, _kinds(name), arrays, file.name)
        several = held if isinstance(held, tuple) else () if held is None else (held,)
        for number, capture in enumerate(several):
            marked = _marked(capture, len(session.archive) + len(stored) + 1, file, session)
            stored.append(StoreCapture(name, marked, number > 0, file.name))
        if several and not several[-1].partial:
            taken.append(name)
    if missing := [name for name in only if name not in taken]:
        known = ", ".join(sorted({key.partition("/")[0] for key in arrays if "/" in key}))
        raise InvalidInputError(f"{file.name} has no {', '.join(missing)}; it has {known}")
    if not stored:
        raise InvalidInputError(f"{file.name} holds no captures")
    return [*stored, *_follow(taken, session)]


def _follow(taken: list[str], session: Session) -> list[Message]:
    def there(name: str) -> bool:
        return name in taken or session.results.get(name) is not None

    wanted = [FOLLOWS[name] for name in FOLLOWS if name in taken]
    return [message() for message, needs in wanted if all(map(there, needs))]


def _marked(capture: Capture, ordinal: int, file: NamedFile, session: Session) -> Capture:
    """Return a capture as one that came out of a file, with what is within it."""
    digest = imported_digest([file.data], setup_of_import(capture, session))
    made: Any = capture
    return replace(made, ordinal=ordinal, setup_digest=digest)


def _kinds(name: str) -> tuple[type, ...]:
    """Return the classes that a capture of this name may be of."""
    if REGISTRY.captures[name].types:
        return REGISTRY.captures[name].types
    hint = Captures.__annotations__.get(name)
    return tuple(kind for kind in _named(hint) if kind is not type(None))


def _named(hint: Any) -> tuple[type, ...]:
    inner = [one for one in get_args(hint) if one is not Ellipsis]
    return tuple(kind for one in inner for kind in _named(one)) if inner else (hint,)


def _text(arrays: Found, key: str) -> str:
    value = arrays.get(key)
    return "" if value is None else str(value)


def _require_same_devices(name: str, arrays: Found, session: Session) -> None:
    """Refuse captures of other devices than those of the set-up, where the file names them."""
    devices = session.setup.devices
    here = {"robot": devices.robot.model, "pointer": devices.pointer, "probe": devices.probe.name}
    for what, chosen in here.items():
        stated = _text(arrays, f"@{what}")
        if stated and stated != chosen:
            raise InvalidInputError(
                f"{name} was recorded with the {what} {stated}, the set-up has {chosen}: choose "
                "the same in step 1"
            )


STEP = declare.Step(
    "imports",
    activities=(
        declare.Activity(
            StartImport,
            perform_import,
            "Reading the file",
            makes=tuple(FOLLOWS),
            of_several_steps=True,
        ),
    ),
)
