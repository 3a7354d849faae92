"""What workers of a study run in tests: a number back, or the end of the worker."""

import os
import signal
from pathlib import Path


def seed_or_death(patient, **_):
    """Return the seed; a patient with a file to write ends its worker: always, or but once."""
    if file := patient.files.get("always"):
        Path(file).open("a").write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    if (file := patient.files.get("once")) and not Path(file).exists():
        Path(file).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return patient.seed
