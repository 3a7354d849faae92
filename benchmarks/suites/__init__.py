"""One module a suite; each has ``run(progress) -> list[Metric]``."""
