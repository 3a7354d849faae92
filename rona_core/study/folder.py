"""The folder of a study: its plan, a row a patient, one table of them, and the sessions it keeps.

Each row is a file of its own that is written whole or not at all, so that a study that was killed
has every row that was finished, and none twice.
"""

import csv
import io
import json
import os
import tomllib
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rona_core.app.declarations.figures import FIGURES
from rona_core.errors import NameTakenError, NotFoundError, storing
from rona_core.session.files import lock_file, remove_stale_temporaries, write_whole
from rona_core.study.patient import Row
from rona_core.study.plan import Plan, plan_of

PLAN, TABLE, PARQUET, SCHEMA = "plan.toml", "patients.csv", "patients.parquet", "schema.json"
HEAD = {  # columns that are no figure -> unit, meaning
    "key": ("", "digest of all that the row follows from"),
    "seed": ("", "of the patient, the placement and every noise"),
    "version": ("", "of RONA"),
    "specimen": ("", "what is scanned"),
    "robot": ("", "name of the robot"),
    "world": ("", "profile of the world"),
    "failure_code": ("", "code of the error, or state of what is not usable"),
    "cpu_s": ("s", "CPU time of the whole patient"),
}


class StudyFolder:
    """Reads and writes the folder of a study."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @contextmanager
    def held(self, plan: Plan) -> Generator[None]:
        """Be the only study that writes here; the plan of the last one stays beside its rows.

        Raises:
            NameTakenError: another one is writing here.
            StorageError: the file system refused.
        """
        with storing(self.path):
            for folder in (self._rows, self._sessions):
                folder.mkdir(parents=True, exist_ok=True)
                remove_stale_temporaries(folder)
            descriptor = os.open(self.path / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if not lock_file(descriptor):
                words = f"another study is writing in {self.path}: wait for it, or end it"
                raise NameTakenError(words)
            write_whole(self.path / PLAN, plan.text.encode())
            yield
        finally:
            os.close(descriptor)

    def plan(self) -> Plan:
        """Return the plan that was run here last.

        Raises:
            NotFoundError: no study was run here.
            InvalidInputError: the plan does not fit this version.
        """
        path = self.path / PLAN
        if not path.is_file():
            raise NotFoundError(f"{self.path} holds no study: it has no {PLAN}")
        text = path.read_text("utf-8")
        return plan_of(tomllib.loads(text), self.path.name, text)

    def rows(self, plan: Plan) -> dict[str, Row]:
        """Return the rows of the patients of a plan that are finished, by key, in its order."""
        keys = [patient.key for patient in plan.patients()]
        there = {path.stem for path in self._rows.glob("*.json")}
        with storing(self._rows):
            return {key: json.loads(self._row(key).read_bytes()) for key in keys if key in there}

    def write_row(self, row: Row) -> None:
        """Write the row of a patient, whole or not at all."""
        write_whole(self._row(row["key"]), json.dumps(row, allow_nan=False).encode())

    def session(self, key: str) -> Path:
        """Return the path of a patient's session, which need not be there."""
        return self._sessions / f"{key}.rona"

    def write_session(self, key: str, data: bytes) -> None:
        """Write the session of a patient."""
        write_whole(self.session(key), data)

    def keep_sessions(self, keys: Sequence[str]) -> None:
        """Remove the sessions of all other patients."""
        for path in self._sessions.glob("*.rona"):
            if path.stem not in keys:
                path.unlink()

    def write_table(self, plan: Plan, rows: Sequence[Row]) -> Path:
        """Write all rows as one table with its schema: Parquet with pyarrow, CSV without."""
        columns = columns_of(plan, rows)
        schema = [
            {"name": name, "unit": unit, "says": says} for name, (unit, says) in columns.items()
        ]
        write_whole(self.path / SCHEMA, json.dumps(schema, indent=1, ensure_ascii=False).encode())
        if find_spec("pyarrow") is not None:
            return write_whole(self.path / PARQUET, _parquet(columns, rows))
        return write_whole(self.path / TABLE, _csv(columns, rows))

    @property
    def _rows(self) -> Path:
        return self.path / "patients"

    @property
    def _sessions(self) -> Path:
        return self.path / "sessions"

    def _row(self, key: str) -> Path:
        return self._rows / f"{key}.json"


def columns_of(plan: Plan, rows: Sequence[Row]) -> dict[str, tuple[str, str]]:
    """Return unit and meaning of every column: head, factors and figures, in this order."""
    factors = {name: ("", "level of the factor") for name in plan.factors}
    figures = {key: (figure.unit, figure.says) for key, figure in FIGURES.items()}
    present = {name for row in rows for name in row}
    return {name: said for name, said in (HEAD | factors | figures).items() if name in present}


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, (list, dict)) else value


def _csv(columns: Mapping[str, Any], rows: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([_cell(row.get(name)) for name in columns] for row in rows)
    return text.getvalue().encode()


def _parquet(columns: Mapping[str, tuple[str, str]], rows: Sequence[Row]) -> bytes:
    """Return the table as Parquet, unit and meaning in the metadata of each field."""
    import pyarrow
    from pyarrow import parquet

    arrays: list[Any] = []
    for name in columns:
        values = [_cell(row.get(name)) for row in rows]
        kinds = {type(value) for value in values if value is not None}
        if not kinds <= {int, float} and len(kinds) > 1:  # levels of several kinds
            values = [None if value is None else str(value) for value in values]
        elif float in kinds:
            values = [None if value is None else float(value) for value in values]
        arrays.append(pyarrow.array(values))
    fields = [
        pyarrow.field(name, array.type, metadata={"unit": unit, "description": says})
        for (name, (unit, says)), array in zip(columns.items(), arrays, strict=True)
    ]
    sink = io.BytesIO()
    parquet.write_table(pyarrow.table(arrays, schema=pyarrow.schema(fields)), sink)
    return sink.getvalue()
