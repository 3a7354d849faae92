"""Readers for a process of their own: they import as little as that process needs."""

import os
import resource
import signal

import numpy as np


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
