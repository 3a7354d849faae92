"""One patient of a study, as a worker runs it: figures as a row, or the session as a file."""

import time
from typing import Any, Unpack

from rona_core import __version__
from rona_core.app.runtime.process_pool import release_memory
from rona_core.compose import run_patient
from rona_core.devices.protocols import Work
from rona_core.errors import CancelledError, InvalidInputError, RonaError
from rona_core.session.files import session_bytes
from rona_core.study.plan import Patient

Row = dict[str, Any]
DEFECT = "defect"  # code of an error that is none of ours


def run_row(patient: Patient, **_work: Unpack[Work]) -> Row:
    """Run a patient and return its row: key, seed, version, levels, figures and CPU time.

    A patient that fails has a row too, with ``failed_step``, ``failure_code`` and ``reason``. The
    linear algebra has one thread: the row is the same on every machine of a kind, times excepted.

    Raises:
        InvalidInputError: this is another version of RONA than the one that made the plan.
    """
    if patient.version != __version__:
        raise InvalidInputError(
            f"a worker has RONA {__version__}, the study is of {patient.version}: install that"
        )
    begun_s, at = time.process_time(), "setup"

    def follow(step: str, share: float) -> None:
        nonlocal at
        at = step

    try:
        _, figures = run_patient(
            patient.seed, patient.settings, patient.skull, among=patient.stages, progress=follow
        )
    except CancelledError:
        raise
    except RonaError as error:
        figures = failed(at, error.code, str(error))
    except Exception as error:  # a defect costs its patient, not the study
        figures = failed(at, DEFECT, f"{type(error).__name__}: {error}")
    release_memory()
    return row_of(patient, figures) | {"cpu_s": time.process_time() - begun_s}


def run_session(patient: Patient, **_work: Unpack[Work]) -> bytes:
    """Run a patient again and return its session as the bytes of a file.

    Raises:
        RonaError: its set-up is invalid: there is no session.
    """
    session, _figures = run_patient(
        patient.seed, patient.settings, patient.skull, among=patient.stages
    )
    return session_bytes(session)


def row_of(patient: Patient, figures: Row) -> Row:
    """Return the row of a patient with some figures."""
    head = {"key": patient.key, "seed": patient.seed, "version": patient.version}
    return {**head, **patient.levels, **figures}


def failed(step: str | None, code: str, reason: str) -> Row:
    """Return the figures of a patient without any."""
    return {"completed": False, "failed_step": step, "failure_code": code, "reason": reason}
