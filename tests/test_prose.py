"""The words of docs/conventions.md: names, docstrings, comments and messages of the product."""

import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
WORDS = ("told", "tells", "heard", "unheard", "nobody", "whoever", "somebody") + (
    "led back", "what it is", "worked out", "for ever",
)  # fmt: skip
WORD = re.compile(rf"(?<![a-z])({'|'.join(WORDS)})(?![a-z])", re.IGNORECASE)
READ = (tokenize.NAME, tokenize.STRING, tokenize.COMMENT)


def found_in(source: str) -> list[str]:
    """Return the words in names, strings and comments of a module, each with its line."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return [
        f"{token.start[0]}: {match[0]}"
        for token in tokens
        if token.type in READ
        for match in WORD.finditer(token.string)
    ]


def test_the_product_speaks_plainly():
    modules = [p for name in ("rona_core", "rona_ui") for p in (ROOT / name).rglob("*.py")]
    pages = [p for p in (ROOT / "static").rglob("*") if p.suffix in (".js", ".html", ".css")]
    hits = {p: found_in(p.read_text(encoding="utf-8")) for p in modules}
    hits |= {p: WORD.findall(p.read_text(encoding="utf-8")) for p in pages}
    assert not {p.relative_to(ROOT).as_posix(): words for p, words in hits.items() if words}


@pytest.mark.parametrize(
    "line", ['"""What one step is told."""', "UNHEARD_MM = 1", "# nobody knows", "told_share = 1"]
)
def test_a_private_word_is_found(line):
    assert found_in(line + "\n")


def test_longer_words_are_not():
    assert not found_in("# foretold by a whosoever\n")
