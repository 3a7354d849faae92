"""Readers of foreign formats in a separate process, with bounded memory and time.

Libraries that read binary files of others crash on some damaged ones, and take whatever memory a
file asks for. Here that ends a process that did nothing else, and the file is refused.
"""

import importlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError, StorageError, storing

Found = dict[str, NDArray[Any] | None]  # None: a name in the file whose contents are not needed
Reader = Callable[[Path, str], Mapping[str, NDArray[Any] | None]]

MOST_BYTES = 1024**3  # of memory, beyond what the libraries themselves take
MOST_CPU_S = 120
MOST_WALL_S = 600.0
CONTENTS, REPORT = "contents", "report.json"
CODE = "from rona_core.devices.files.reader_process import main; main()"
LONGEST_WORDS = 160


def read_apart(reader: Reader, source: bytes | Path, name: str, kind: str) -> Found:
    """Return the arrays that ``reader`` finds in a file, read in a process of its own.

    Args:
        reader: A function of a module, called with the path of the file and its name; it returns
            arrays of numbers. Whatever it throws means that the file is damaged.
        source: Contents of the file, or its path.
        name: Of the file, for messages.
        kind: Of the file, for messages.

    Raises:
        InvalidInputError: refused by the reader, damaged, or one that needs too much memory or
            time, or that crashes the library.
        StorageError: no space or no right for the temporary files that this takes.
    """
    with storing(tempfile.gettempdir()):
        temporary = tempfile.TemporaryDirectory(prefix="rona-")
    with temporary as place:
        folder = Path(place)
        path = source.resolve() if isinstance(source, Path) else folder / CONTENTS
        if isinstance(source, bytes):
            with storing(place):
                path.write_bytes(source)
        job = json.dumps([reader.__module__, reader.__name__, place, str(path), name])
        paths = os.pathsep.join(str(Path(entry or ".").resolve()) for entry in sys.path)
        limits = {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        try:
            ended = subprocess.run(
                [sys.executable, "-c", CODE, job],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **limits},
                timeout=MOST_WALL_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise InvalidInputError(_too_slow(name, kind)) from error
        if ended.returncode == os.EX_IOERR:
            raise StorageError(
                f"what {name} holds could not be put down in {place}: free space there, or set "
                "TMPDIR to another folder"
            )
        report = folder / REPORT
        if not report.is_file():
            raise InvalidInputError(_why(ended.returncode, name, kind))
        outcome = json.loads(report.read_text("utf-8"))
        if "error" in outcome:
            raise InvalidInputError(outcome["error"])
        if "damage" in outcome:
            raise InvalidInputError(f"{name} is a damaged {kind} file: {outcome['damage']}")
        return {
            key: None if file is None else np.load(folder / file, allow_pickle=False)
            for key, file in outcome["arrays"].items()
        }


def _why(status: int, name: str, kind: str) -> str:
    """Return why there is no report."""
    if -status == signal.SIGXCPU:
        return _too_slow(name, kind)
    if -status == signal.SIGKILL:  # by the limit of time, or by a system that is short of memory
        return f"{_too_slow(name, kind)}. It may also need more memory than there is"
    if status < 0:
        return (
            f"{name} is a damaged {kind} file: its reader crashed on it "
            f"({signal.Signals(-status).name}); write it again"
        )
    return _too_large(name)


def _too_slow(name: str, kind: str) -> str:
    return (
        f"{name} could not be read as {kind} within {MOST_CPU_S} s: it is damaged or too large; "
        "write it again, or a part of it"
    )


def _too_large(name: str) -> str:
    return (
        f"{name} needs more than {MOST_BYTES / 1e6:.0f} MB of memory to be read: it is damaged or "
        "too large; write it again, or a part of it"
    )


# ------------------------------------------------------------------ in the process


def main() -> None:
    """Read the file that the parent process put down, and put down what was found."""
    module, function, place, path, name = json.loads(sys.argv[1])
    reader: Reader = getattr(importlib.import_module(module), function)
    _bound()
    try:
        outcome = _report(reader, Path(path), Path(place), name)
        (Path(place) / REPORT).write_text(json.dumps(outcome), "utf-8")
    except OSError:  # of our own files; the reader's are caught
        sys.exit(os.EX_IOERR)


def _report(reader: Reader, path: Path, folder: Path, name: str) -> dict[str, Any]:
    files: dict[str, str | None] = {}
    try:
        for i, (key, value) in enumerate(reader(path, name).items()):
            files[key] = None if value is None else f"{i}.npy"
            if value is not None:
                with storing(folder):
                    np.save(folder / f"{i}.npy", value, allow_pickle=False)
    except StorageError:
        raise
    except InvalidInputError as error:
        return {"error": str(error)}
    except MemoryError:
        return {"error": _too_large(name)}
    except Exception as error:  # the libraries throw whatever they like at damaged files
        return {"damage": re.sub(r"\s+", " ", str(error))[:LONGEST_WORDS] or type(error).__name__}
    return {"arrays": files}


def _bound() -> None:
    """Limit memory and time of this process, where the system can."""
    try:
        import resource
    except ImportError:  # no such limits here
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S + 5))
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    wanted = _address_space() + MOST_BYTES
    if most == resource.RLIM_INFINITY or wanted < most:
        resource.setrlimit(resource.RLIMIT_AS, (wanted, most))


def _address_space() -> int:
    """Return the bytes of addresses that this process has now."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        return pages * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 3 * MOST_BYTES  # more than the libraries take


def require_size(shape: tuple[int, ...], most: int, what: str) -> None:
    """Refuse an array before memory is taken for it.

    Raises:
        InvalidInputError: ``shape`` has more than ``most`` values.
    """
    size = math.prod(shape)
    if size > most:
        raise InvalidInputError(f"{what} has {size} values: {most} are allowed")
