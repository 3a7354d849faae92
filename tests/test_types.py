"""The checker of types finds faults of many kinds with the settings of this project."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pyrefly", reason="the checker of types is installed by `make check`")
pytestmark = pytest.mark.slow  # `make check` runs it

ROOT = Path(__file__).resolve().parents[1]
FAULTS = """
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypedDict

import numpy as np

from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics import arm


class Stopped(Protocol):
    def stop(self, after_s: float) -> None: ...


class NeverStopped:
    def halt(self) -> None: ...


class Base:
    def way(self, n: int) -> float:
        return float(n)


class Child(Base):
    def way(self, n: str, k: int) -> float:  # FAULT overrides otherwise
        return 0.0


@dataclass(frozen=True, slots=True)
class Row:
    name: str
    value: float | None
    kind: Literal["a", "b"] = "a"


class Keys(TypedDict):
    x: int


def stop(held: Stopped) -> None:
    held.stop(1.0)


def none(row: Row) -> float:
    return row.value + 1.0  # FAULT may be None


def attribute(row: Row) -> str:
    return row.nane  # FAULT no such attribute


def missing() -> Row:
    return Row("a")  # FAULT an argument is missing


def extra() -> Row:
    return Row("a", 1.0, wrong=3)  # FAULT no such argument


def kind() -> Row:
    return Row(3, 1.0)  # FAULT another type


def returned(row: Row) -> str:
    return row.value is None  # FAULT another type comes back


def protocol() -> None:
    stop(NeverStopped())  # FAULT does not keep the protocol


def frozen(row: Row) -> None:
    row.name = "b"  # FAULT is frozen


def unpacked() -> int:
    a, b = (1, 2, 3)  # FAULT as many as there are
    return a + b


def called(go: Callable[[int], str]) -> str:
    return go("x")  # FAULT takes a number


def unbound(n: int) -> int:
    if n > 3:
        found = 1
    return found  # FAULT may have no value


def key(keys: Keys) -> int:
    return keys["y"]  # FAULT no such key


def literal() -> Row:
    return Row("a", None, "c")  # FAULT none of the words


def index(rows: Sequence[Row]) -> str:
    return rows[0]["name"]  # FAULT has no items


def of_the_project(pose: Pose) -> float:
    return pose.translation_mm  # FAULT has another name


def generic(rows: list) -> int:  # FAULT of what
    return len(rows)


def unannotated(x) -> int:  # FAULT what is x
    return 1


def without_return(n: int):  # FAULT what comes back
    return n


def replaced_name(row: Row) -> Row:
    return replace(row, valu=3.0)  # FAULT no such field


def replaced_type(row: Row) -> Row:
    return replace(row, value="3")  # FAULT a field of another type


def summed(rows: Sequence[Row]) -> float:
    return sum(row.value for row in rows)  # FAULT one may be None


def matched(row: Row) -> str:
    match row.kind:  # FAULT b is left out
        case "a":
            return "x"
    return ""


def of_numpy() -> float:
    return np.zeros(3).sume()  # FAULT has another name


def operator(pose: Pose) -> float:
    return pose / 3.0  # FAULT cannot be divided


def of_a_module() -> float:
    return arm.nothing_here  # FAULT not there


def passed(go: Callable[[Row], float]) -> float:
    return go(Row("", 1.0))


def other_signature() -> float:
    return passed(kind)  # FAULT takes no row


async def later() -> int:
    return 1


def not_awaited() -> int:
    return later()  # FAULT is not awaited
"""


def test_each_planted_fault_of_types_is_found(tmp_path):
    file = tmp_path / "faults.py"
    file.write_text(FAULTS)
    run = subprocess.run(
        [
            *(sys.executable, "-m", "pyrefly", "check", "--output-format", "min-text"),
            *("--config", ROOT / "pyproject.toml", "--search-path", ROOT),
            *("--python-interpreter-path", sys.executable, file),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    found = {int(line) for line in re.findall(r"faults\.py:(\d+)", run.stdout)}
    planted = {
        number: line.partition("# FAULT ")[2]
        for number, line in enumerate(FAULTS.splitlines(), 1)
        if "# FAULT" in line
    }
    assert len(planted) == 28
    assert not {line: fault for line, fault in planted.items() if line not in found}, run.stderr
    assert found == set(planted)
