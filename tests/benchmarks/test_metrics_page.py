"""The page of figures is written from their list, and names no figure that there is not."""

import re

from benchmarks import metrics_page
from rona_core.app.declarations.figures import FIGURES, SECTIONS

KEYS = re.compile(r"[a-z]\w+_(?:mm|deg|n|s|percent|fraction|points|probability)")


def test_the_page_of_figures_is_written_from_the_list():
    page = metrics_page.PAGE.read_text("utf-8")
    assert metrics_page.with_tables(page) == page, "run `make metrics`"
    names = [name for _, name, _ in metrics_page.TABLE.findall(page)]
    assert sorted(names) == sorted([*SECTIONS, "Limits"])


def test_meanings_name_figures_that_there_are():
    page = metrics_page.PAGE.read_text("utf-8")
    named = {
        word for one in FIGURES.values() for word in re.findall(r"`(\w+)`", one.says + one.source)
    }
    named |= set(re.findall(r"`(\w+)`", page))
    assert not [word for word in named if KEYS.fullmatch(word) and word not in FIGURES]
