"""Bed of an implant: how it is milled, against closed forms and the implant that has to go in."""

from benchmarks.metric import Metric, Progress
from benchmarks.suites.implant import milled_beds, pole


def run(progress: Progress) -> list[Metric]:
    """Return all figures."""
    return [*milled_beds.metrics(progress), *pole.metrics(progress)]
