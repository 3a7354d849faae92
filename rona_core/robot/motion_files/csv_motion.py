"""Motion as a table: a time and six joint angles a row, the unit of each in its name."""

import re

import numpy as np

from rona_core.devices.files.text_tables import NamedFile, Table, read_table
from rona_core.devices.limits import require
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.joint_names import columns_of_joints
from rona_core.robot.verification.joint_motion import JointMotion

COLUMNS = ("time_s", *(f"q{joint}_rad" for joint in range(1, 7)))
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
UNITS = {"rad": 1.0, "deg": float(np.pi / 180.0)}
RATES = {0: "", 1: "_per_s", 2: "_per_s2"}
ANGLE = re.compile(r"(dd|d|)(.+)_(rad|deg)(_per_s2|_per_s|)")
EXPECTED = "expected time_s, q1_rad to q6_rad (or time_ms, q1_deg)"


def write_csv(certified: CertifiedMotion) -> bytes:
    """Return a motion as a table, digits in full, with its further columns.

    Raises:
        InvalidInputError: a column that is not as long as the motion.
    """
    further, motion = certified.columns, certified.motion
    n = len(motion.times_s)
    for name, values in further.items():
        require(len(values) == n, f"column {name} must have {n} values, not {len(values)}")
    lines = [*(f"# {line}" for line in certified.lines()), ",".join((*COLUMNS, *further))]
    for k, row in enumerate(np.column_stack((motion.times_s, motion.qs_rad)).tolist()):
        cells = (*map(repr, row), *(str(values[k]) for values in further.values()))
        lines.append(",".join(cells))
    return ("\n".join(lines) + "\n").encode("utf-8")


def read_csv(file: NamedFile, model: RobotModel) -> JointMotion:
    """Read a table with a header; other columns than those of time and joints are left out.

    Speeds are ``dq1_rad_per_s``, accelerations ``ddq1_rad_per_s2``.

    Raises:
        InvalidInputError: no header, a unit or joint that is missing, or a cell that is no number;
            it says where.
    """
    table = read_table(file)
    if table.header is None:
        raise InvalidInputError(
            f"{file.name} has no header, so nothing says which column is which joint and in what "
            f"unit: {EXPECTED}"
        )
    times = _times(table)
    orders = [_angles(table, order, model) for order in RATES]
    qs = orders[0]
    if qs is None:
        raise InvalidInputError(
            f"{file.name} states no joint angles with their unit: {EXPECTED}, got "
            f"{', '.join(table.header)}"
        )
    return JointMotion(times, qs, orders[1], orders[2] if orders[1] is not None else None)


def _times(table: Table) -> Floats:
    header = table.header or ()
    for unit, factor in TIMES.items():
        if f"time_{unit}" in header:
            return factor * _column(table, header.index(f"time_{unit}"))
    raise InvalidInputError(
        f"{table.name} states no time with its unit: {EXPECTED}, got {', '.join(header)}"
    )


def _angles(table: Table, order: int, model: RobotModel) -> Floats | None:
    """Return the columns (n, 6) of joint angles (0), speeds (1) or accelerations (2), if any."""
    found: dict[str, tuple[int, float]] = {}
    for column, name in enumerate(table.header or ()):
        named = ANGLE.fullmatch(name)
        if named and len(named[1]) == order and named[4] == RATES[order]:
            found[named[2]] = column, UNITS[named[3]]
    if not found:
        return None
    stated = list(found)
    chosen = [found[stated[k]] for k in columns_of_joints(stated, model, table.name)]
    return np.column_stack([factor * _column(table, column) for column, factor in chosen])


def _column(table: Table, column: int) -> Floats:
    """Return a column (n,) as finite numbers."""
    values = np.zeros(len(table.rows))
    for sample, row in enumerate(table.rows):
        cell = row[column] if column < len(row) else ""
        try:
            values[sample] = float(cell)
        except ValueError:
            values[sample] = np.nan
        if not np.isfinite(values[sample]):
            name = (table.header or ())[column]
            raise InvalidInputError(
                f"{table.where(sample)}: {name} of sample {sample} must be a finite number, not "
                f"{cell[:40]!r}"
            )
    return values
