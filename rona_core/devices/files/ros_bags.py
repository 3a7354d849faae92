"""Messages in recordings of ROS: a bag of ROS 2 (.db3, .mcap), MCAP, a bag of ROS 1.

The packages that read them are those of the extra ``rona[bags]``, imported when there is such a
file; what calls this runs in a process of its own (``reader_process``).
"""

import json
import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError

SUFFIXES = {b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\0": ".db3", b"#ROSBAG": ".bag"}


def is_bag(file: NamedFile) -> bool:
    """Return whether a file is a recording of ROS, by its first bytes."""
    return file.data.startswith(tuple(SUFFIXES))


def bag_messages(path: Path, name: str) -> Iterator[tuple[str, str, int, Any]]:
    """Yield topic, type (of MCAP in JSON the schema's name), time of the log in ns, and message.

    Args:
        path: Of the file.
        name: Of the file, for messages.

    Raises:
        InvalidInputError: the packages of the extra are missing; of a damaged file whatever they
            throw.
    """
    with path.open("rb") as file:
        start = file.read(16)
    suffix = next(suffix for magic, suffix in SUFFIXES.items() if start.startswith(magic))
    try:
        yield from _mcap(path) if suffix == ".mcap" else _rosbag(path, suffix)
    except ImportError as error:
        raise InvalidInputError(
            f"{name} is a recording of ROS, which needs the package {error.name}: "
            "pip install 'rona[bags]'"
        ) from error


def message_types() -> Any:
    """Return the types of ROS 2 Humble, a store of rosbags; ImportError without the extra."""
    typesys: Any = import_module("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _rosbag(path: Path, suffix: str) -> Iterator[tuple[str, str, int, Any]]:
    rosbags: Any = import_module("rosbags.highlevel")
    named = path.with_name(f"bag{suffix}")  # its reader goes by the suffix
    os.symlink(path, named)
    with rosbags.AnyReader([named], default_typestore=message_types()) as reader:
        for connection, stamp_ns, data in reader.messages():
            kind = connection.msgtype
            yield connection.topic, kind, stamp_ns, reader.deserialize(data, kind)


def _mcap(path: Path) -> Iterator[tuple[str, str, int, Any]]:
    reader: Any = import_module("mcap.reader")
    types = message_types()
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            kind = schema.name if schema is not None else ""
            if channel.message_encoding == "json":
                plain = json.loads(message.data, object_hook=lambda o: SimpleNamespace(**o))
                yield channel.topic, kind, message.log_time, plain
            elif channel.message_encoding == "cdr" and kind in types.fielddefs:
                found = types.deserialize_cdr(message.data, kind)
                yield channel.topic, kind, message.log_time, found
