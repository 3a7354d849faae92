"""The documents are complete: links lead somewhere, pages have their parts, names exist."""

import ast
import importlib
import io
import re
from contextlib import redirect_stdout
from fnmatch import filter as matching
from pathlib import Path

import pytest

from docs.guide import settings_page
from rona_core.errors import RonaError
from rona_core.study.engines import WorkerDiedError
from rona_ui.api.problems import JobFinishedError

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
CODE = ("rona_core", "rona_ui", "benchmarks", "examples", "tests")
PAGES = [*sorted(DOCS.rglob("*.md")), *sorted(ROOT.glob("*.md"))]
ALGORITHMS = sorted((DOCS / "algorithms").rglob("*.md"))
DECISIONS = sorted((DOCS / "decisions").glob("*.md"))
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")

# every algorithm page says these five things, under headings of its own choosing
PARTS = {
    "problem": r"problem|question|what (it|they|is)|purpose|task",
    "method": r"equation|method|how|model|algorithm|idea",
    "failure": r"fail|limit|refus|degenerat|wrong",
    "reference": r"reference|source",
    "test": r"test|proof|prove|check",
}

# a source in running text: "Kabsch 1976", "Fry and Barger 1978", "Aubry et al. 2022"
CITATION = re.compile(
    r"\b([A-Z][a-zà-ž]+(?:-[A-Z][a-zà-ž]+)?)(?:,? (?:and|&) [A-Z][\w-]+| et al\.?)?,? "
    r"\(?((?:18|19|20)\d\d)\b"
)
NO_AUTHOR = set(
    "January February March April May June July August September October November December "
    "Copyright Python Debian Ubuntu Since Until After Before In Edition Version Windows".split()
)


def text(path):
    return path.read_text("utf-8")


def name(path):
    return str(path.relative_to(ROOT))


def without_code(page):
    return re.sub(r"```.*?```|`[^`\n]*`", "", page, flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    broken = []
    for link in LINK.findall(without_code(text(page))):
        target, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        file = (page.parent / target).resolve() if target else page
        if not file.exists():
            broken.append(link)
        elif anchor and anchor not in anchors(text(file)):
            broken.append(link)
    assert not broken


def test_pages_that_code_names_exist():
    named = {
        (name(file), page)
        for top in CODE
        for file in (ROOT / top).rglob("*.py")
        for page in re.findall(r"\bdocs/[\w/-]+\.md\b", text(file))
    }
    assert named
    assert not [(file, page) for file, page in named if not (ROOT / page).is_file()]


def suffixes(path):
    """Return the ways to name a file: `pivot/quality.py` is as good as its whole path."""
    parts = path.relative_to(ROOT).parts
    return {"/".join(parts[k:]) for k in range(len(parts))}


def test_files_that_are_named_in_back_quotes_exist():
    code = [file for top in CODE for file in (ROOT / top).rglob("*.py")]
    known = {way for file in [*code, *PAGES, ROOT / "setup.py"] for way in suffixes(file)}
    named = {
        (name(file), found)
        for file in [*code, *PAGES]
        if file.name != "CHANGELOG.md"  # speaks of names that are gone
        for found in re.findall(r"`([\w./*-]*\w\.(?:py|md))`", text(file))
    }
    assert len(named) > 100
    assert not sorted(
        (file, found) for file, found in named if found not in known and not matching(known, found)
    )


def anchors(page):
    titles = re.findall(r"^#+ (.*)$", page, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", ALGORITHMS, ids=name)
def test_an_algorithm_page_has_its_parts_and_is_linked(page):
    found = re.findall(r"^#{2,} (.*)$|^\*\*(.+?)\*\*", text(page), re.MULTILINE)
    headings = " | ".join(title or bold for title, bold in found)
    missing = [part for part, words in PARTS.items() if not re.search(words, headings, re.I)]
    assert not missing, f"no heading for {missing} among: {headings}"
    assert f"({page.relative_to(DOCS)})" in text(DOCS / "index.md")


@pytest.mark.parametrize("page", ALGORITHMS, ids=name)
def test_an_algorithm_page_names_a_test_that_exists(page):
    named = set(re.findall(r"\btests/[\w/]+\.py", text(page)))
    named |= {f"tests/{found}" for found in re.findall(r"(?<!/)\bcore/test_\w+\.py", text(page))}
    named |= {
        str(p.relative_to(ROOT))
        for stem in re.findall(r"(?<!/)\b(test_\w+)\.py", text(page))
        for p in (ROOT / "tests").rglob(f"{stem}.py")
    }
    assert named, "no test file is named"
    assert not [path for path in named if not (ROOT / path).is_file()]


def test_decisions_are_numbered_without_gaps_and_have_their_parts():
    assert [p.name[:5] for p in DECISIONS] == [f"{i:04}-" for i in range(1, len(DECISIONS) + 1)]
    for number, page in enumerate(DECISIONS, 1):
        assert text(page).startswith(f"# {number}. "), name(page)
        assert re.search(r"^Status: (proposed|accepted|superseded by \[.*\])$", text(page), re.M)
        headings = re.findall(r"^## (.*)$", text(page), re.MULTILINE)
        assert headings == ["Context", "Decision", "Consequences"], name(page)
        assert f"(decisions/{page.name})" in text(DOCS / "index.md"), name(page)


def test_every_page_can_be_reached_from_the_readme():
    reached, todo = set(), [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page in reached or page.suffix != ".md" or not page.is_file():
            continue
        reached.add(page)
        for link in LINK.findall(text(page)):
            if not re.match(r"[a-z]+:", link):
                todo.append((page.parent / link.partition("#")[0]).resolve())
    assert not [name(p) for p in DOCS.rglob("*.md") if p not in reached]


def test_the_readme_shows_a_new_user_the_way():
    readme = text(ROOT / "README.md")
    first = readme[: readme.index("\n## ")]
    assert "make run" in first
    assert "make test" in first
    assert "Not a medical device" in readme


def test_the_example_of_the_readme_runs():
    blocks = re.findall(r"```python\n(.*?)```", text(ROOT / "README.md"), flags=re.DOTALL)
    assert blocks
    for block in blocks:
        printed = io.StringIO()
        with redirect_stdout(printed):
            exec(compile(block, "README.md", "exec"), {})
        points = [
            int(n) for n in re.findall(r"\d+(?= points|  *->)|(?<=-> )\d+", printed.getvalue())
        ]
        assert points[0] > points[1] > 2
        assert float(re.search(r"([\d.]+) mm", printed.getvalue())[1]) <= 1.0


def test_every_verb_that_is_named_exists():
    verbs = set(re.findall(r"^([a-z]+):", text(ROOT / "Makefile"), flags=re.MULTILINE))
    for page in PAGES:
        named = set(re.findall(r"(?:`|^    )make ([a-z]+)", text(page), flags=re.MULTILINE))
        assert named <= verbs, name(page)


def test_every_verb_is_explained_where_it_is_defined():
    makefile = text(ROOT / "Makefile")
    verbs = {"run", "test", "check", "bench", "demo", "constraints", "clean"}
    assert verbs <= set(re.findall(r"^#   make (\w+)", makefile, flags=re.MULTILINE))
    assert verbs <= set(re.findall(r"^(\w+):", makefile, flags=re.MULTILINE))


def test_every_source_that_is_cited_is_in_the_references():
    keys = set(re.findall(r"^\| ([\w-]+ \d{4}) \|", text(DOCS / "references.md"), re.MULTILINE))
    cited = {}
    for path in [*(ROOT / "rona_core").rglob("*.py"), *ALGORITHMS]:
        for author, year in CITATION.findall(text(path)):
            if author not in NO_AUTHOR:
                cited.setdefault(f"{author} {year}", name(path))
    unknown = {key: path for key, path in cited.items() if key not in keys}
    assert not unknown


def test_every_message_says_what_it_does():
    registry = importlib.import_module("rona_core.app.declarations.registry").REGISTRY
    assert registry.commands
    assert registry.activities
    silent = [name for name, t in registry.messages.items() if not is_sentence(t.__doc__)]
    assert not silent


def is_sentence(docstring):
    first = (docstring or "").strip().split("\n\n")[0]
    return first[:1].isupper() and first.endswith(".") and not re.match(r"\w+\(", first)


def test_every_module_says_what_it_is_for():
    files = [p for top in ("rona_core", "rona_ui") for p in (ROOT / top).rglob("*.py")]
    silent = [
        name(p) for p in files if text(p).strip() and not ast.get_docstring(ast.parse(text(p)))
    ]
    assert not silent


def test_one_version_everywhere():
    version = importlib.import_module("rona_core").__version__
    assert f"version: {version}\n" in text(ROOT / "CITATION.cff")
    changelog = text(ROOT / "CHANGELOG.md")
    assert f"## [{version}]" in changelog or "## [Unreleased]" in changelog


def test_the_page_of_settings_is_that_of_the_declarations():
    assert text(settings_page.PAGE) == settings_page.page(), "run `make settings`"


IN_README = {  # row of its table -> figure of docs/results.md
    "surface cloud, RMS error": "surface_rms_mm",
    "outer boundary, RMS error": "outer_rms_mm",
    "inner boundary, RMS error": "inner_rms_mm",
    "thickness, RMS error": "thickness_rms_mm",
}


def cells(page, start):
    """The cells of the one row of a page whose first cell has some words."""
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in page.splitlines()
        if line.startswith("|")
    ]
    (found,) = [row for row in rows if start in row[0]]
    return found


@pytest.mark.parametrize("words", IN_README)
def test_the_table_of_the_readme_has_the_figures_of_the_results(words):
    _, _, _, median, _, worst, _, _ = cells(text(DOCS / "results.md"), f"`{IN_README[words]}`")
    stated = cells(text(ROOT / "README.md"), words)[1]
    assert stated == f"{median.removesuffix(' mm')} ({worst.removesuffix(' mm')}) mm"


@pytest.mark.parametrize(
    ("words", "share"),
    [
        ("patients with no inner boundary", "No inner map"),
        ("patients without a safe bed", "No safe bed"),
    ],
)
def test_the_shares_of_the_readme_are_those_of_the_results(words, share):
    stated = cells(text(ROOT / "README.md"), words)[1]
    _, patients, percent = cells(text(DOCS / "results.md"), share)
    assert stated == f"{patients}: {percent}"


def codes_of(error: type[RonaError]) -> set[str]:
    return {error.code}.union(*(codes_of(kind) for kind in error.__subclasses__()))


def test_every_code_of_an_error_stands_on_the_page_of_rest():
    assert JobFinishedError in RonaError.__subclasses__()
    never_answered = {RonaError.code, WorkerDiedError.code}  # no error is just that; of a study
    page = text(DOCS / "how-to" / "use_rest.md")
    assert [code for code in codes_of(RonaError) - never_answered if f"`{code}`" not in page] == []
