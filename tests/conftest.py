"""How the suite runs: examples of property tests, and in which order files go to the workers.

Quick tests are those not marked ``slow``; slow ones marked ``ci`` run with them before a change
lands. Property tests draw the same examples on every run, and a busy machine fails none of them.
``RONA_EXAMPLES`` times as many are drawn where that is set: a share of them by the quick tests, ten
times as many on demand.
One worker drives the browsers, one after the other, on one server; the others begin with the files
that took longest in the last run, so that all end together, and leave it the processor where it
wants one.
"""

import gc
import os
import subprocess
from collections import Counter
from functools import cache
from types import SimpleNamespace

import pytest
from hypothesis import settings

settings.register_profile("rona", deadline=None, derandomize=True)
settings.load_profile("rona")

EXAMPLES = float(os.environ.get("RONA_EXAMPLES", "1"))
FEWEST = 5  # examples of a property, unless it has fewer
SECONDS = "rona/seconds_of_files"
BROWSERS = "tests/ui/browser/"  # each draws with a processor of its own: one after the other
# folders whose files share what takes long
TOGETHER = (BROWSERS, "tests/app/dependencies/", "tests/app/implant/", "tests/app/steps/handheld/")
ADDED_NICENESS = 10  # of tests without a browser: hands that move in real time come first
BESIDE_BROWSERS = pytest.StashKey[bool]()  # whether another worker drives browsers
BY_HYPOTHESIS = "_hypothesis_internal_use_settings"


def file_of(nodeid):
    return nodeid.partition("::")[0]


class FileTimes:
    """Notes how long the tests of each file take."""

    def __init__(self, cache):
        self.seconds, self.cache = Counter(cache.get(SECONDS, {})), cache
        self.seen = set()

    def pytest_runtest_logreport(self, report):
        file = file_of(report.nodeid)
        if file not in self.seen:
            self.seen.add(file)
            self.seconds[file] = 0.0
        self.seconds[file] += report.duration

    def pytest_sessionfinish(self):
        self.cache.set(SECONDS, dict(self.seconds))


def pytest_configure(config):
    cache, workers = getattr(config, "cache", None), config.getoption("numprocesses", None)
    if cache and workers and not hasattr(config, "workerinput"):
        config.pluginmanager.register(FileTimes(cache))


def thin_out_sweeps(items):
    """Mark as slow all cases of each sweep but as many as its marker names, evenly spread."""
    sweeps = {}
    for item in items:
        if marker := item.get_closest_marker("sweep"):
            sweeps.setdefault(item.nodeid.partition("[")[0], (marker.args[0], []))[1].append(item)
    for n_quick, cases in sweeps.values():
        steps = max(n_quick - 1, 1)
        quick = {round(k * (len(cases) - 1) / steps) for k in range(n_quick)}
        for number, item in enumerate(cases):
            if number not in quick:
                item.add_marker(pytest.mark.slow)


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their markers
def pytest_collection_modifyitems(config, items):
    thin_out_sweeps(items)
    for item in items:
        if item.get_closest_marker("ci"):
            item.add_marker(pytest.mark.slow)
        test = getattr(item, "obj", None)
        if EXAMPLES != 1.0 and getattr(test, "is_hypothesis_test", False):
            own = getattr(test, BY_HYPOTHESIS)
            n = max(min(FEWEST, own.max_examples), round(EXAMPLES * own.max_examples))
            func = getattr(test, "__func__", test)
            setattr(func, BY_HYPOTHESIS, settings(own, max_examples=n))
    if hasattr(config, "workerinput"):
        cache = getattr(config, "cache", None)
        known = cache.get(SECONDS, {}) if cache else {}
        slow = {file_of(item.nodeid) for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: -known.get(f := file_of(item.nodeid), 60.0 * (f in slow)))
        items.sort(key=lambda item: not item.nodeid.startswith(BROWSERS))


@cache
def leave_the_processor_to_browsers():
    """Let others go first from now on: this worker has no browser to drive."""
    os.nice(ADDED_NICENESS)


def pytest_runtest_setup(item):
    if item.config.stash[BESIDE_BROWSERS] and not item.nodeid.startswith(BROWSERS):
        leave_the_processor_to_browsers()


@pytest.hookimpl(optionalhook=True)  # pytest-xdist need not be installed
def pytest_xdist_make_scheduler(config, log):
    """Give files to the workers; those that share a browser, or results, to one of them."""
    from xdist.scheduler import LoadFileScheduling

    class OneBrowser(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = file_of(nodeid)
            return next((f for f in TOGETHER if file.startswith(f)), file)

    return OneBrowser(config, log)


@pytest.fixture(scope="session")
def demo():
    """The demo session; nothing can change it."""
    from tests.scenes import demo_parts

    return demo_parts.demo()


@pytest.fixture
def readers_here(monkeypatch):
    """Files of others are read in this process, where it is not the reading that is tested."""
    from rona_core.devices.files import reader_process
    from tests.helpers.readers_apart import run_here

    plain = SimpleNamespace(**vars(subprocess))
    plain.run = run_here
    monkeypatch.setattr(reader_process, "subprocess", plain)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Modules and tests live to the end: the collector need not go through them again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish(session):
    session.config.stash[BESIDE_BROWSERS] = hasattr(session.config, "workerinput") and any(
        item.get_closest_marker("browser") for item in session.items
    )
    gc.collect()
    gc.freeze()
