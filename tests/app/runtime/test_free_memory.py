"""Freed memory goes back to the system where the C library can; elsewhere nothing happens."""

import sys
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.runtime import process_pool


@pytest.mark.skipif(sys.platform != "linux", reason="malloc_trim is of glibc")
def test_freed_pieces_go_back_to_the_system():
    if process_pool._trim() is None:
        pytest.skip("this C library has no malloc_trim")

    def resident_pages():
        return int(Path("/proc/self/statm").read_text("ascii").split()[1])

    held = [np.ones(8_000) for _ in range(2_000)]  # 64 kB each: from the heap, not of their own
    kept = held[::100]  # the heap cannot shrink from its end
    full = resident_pages()
    del held
    process_pool.release_memory()
    assert resident_pages() < full - 0.7 * 2_000 * 64_000 / 4_096
    assert all(piece[0] == 1.0 for piece in kept)


def test_without_such_a_library_nothing_happens(monkeypatch):
    asked = []
    monkeypatch.setattr(process_pool, "_trim", lambda: asked.append("trim"))
    assert process_pool.release_memory() is None
    assert asked == ["trim"]
