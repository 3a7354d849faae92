"""Readers for a process of their own, and what reads in this one, which has imported all."""

import importlib
import json
import os
import resource
import signal
import subprocess
from pathlib import Path

import numpy as np

from rona_core.devices.files import reader_process


def run_here(command, **_):
    """Stand in for ``subprocess.run`` of `read_apart`: no limits, and a crash ends the tests."""
    module, function, place, path, name = json.loads(command[-1])
    reader = getattr(importlib.import_module(module), function)
    outcome = reader_process._report(reader, Path(path), Path(place), name)
    (Path(place) / reader_process.REPORT).write_text(json.dumps(outcome), "utf-8")
    return subprocess.CompletedProcess(command, 0)


def crashing(path, name):
    os.kill(os.getpid(), signal.SIGSEGV)


def greedy(path, name):
    return {"a": np.ones(1 << 28)}


def breaking(path, name):
    raise KeyError("half\na word")


def modest(path, name):
    return {"a": np.frombuffer(path.read_bytes(), np.uint8), "b": None}


def unsaved(path, name):
    """A reader after which the disk is full."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    return {"rf": np.zeros(10_000)}
