import threading

import numpy as np
import pytest

from rona_core.devices.live import Live
from rona_core.devices.samples import JointSample, TrackerFrame


def test_new_parts_replace_old_ones_and_snapshots_never_change():
    live = Live()
    before = live.get()
    frame = TrackerFrame(1, 0.5, ())
    live.put(frame=frame)
    live.put(n_scans=3)
    assert before.frame is None
    assert live.get().frame is frame
    assert live.get().n_scans == 3
    with pytest.raises(TypeError):
        live.put(unknown=1)
    assert live.get().frame is frame


def test_writers_and_readers_never_see_half_a_state():
    live, rounds, torn = Live(), 2000, []
    start = threading.Barrier(4)
    reading = threading.Event()

    def write_pair():
        start.wait()
        for i in range(1, rounds + 1):
            joints = JointSample(float(i), np.full(6, float(i)))
            live.put(frame=TrackerFrame(i, float(i), ()), joints=joints)

    def count():
        start.wait()
        for i in range(1, rounds + 1):
            live.put(n_scans=i)

    def read():
        start.wait()
        last = 0
        while not reading.is_set():
            state = live.get()
            if state.frame is not None:
                same = state.joints is not None and state.frame.number == state.joints.q_rad[0]
                if not same or state.n_scans < last:
                    torn.append(state)
            last = state.n_scans

    writers = [threading.Thread(target=write_pair), threading.Thread(target=count)]
    readers = [threading.Thread(target=read) for _ in range(2)]
    for thread in (*writers, *readers):
        thread.start()
    for thread in writers:
        thread.join()
    reading.set()
    for thread in readers:
        thread.join()
    assert torn == []
    state = live.get()  # no update of one writer was lost to the other
    assert state.frame is not None
    assert (state.frame.number, state.n_scans) == (rounds, rounds)
