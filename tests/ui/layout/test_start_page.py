"""Start page: what RONA is, in a light picture, and a line for each way in."""

import re

from rona_ui.resources import static_dir

LIGHT_BYTES = 150_000


def test_it_has_a_light_picture_that_waits_until_it_is_seen() -> None:
    page = (static_dir() / "index.html").read_text()
    image = re.search(r'<img src="static/([^"]+)"[^>]*>', page[page.index('class="about"') :])
    assert image is not None
    assert (static_dir() / image[1]).stat().st_size < LIGHT_BYTES
    assert 'loading="lazy"' in image[0]  # a session that opens at once does not load it
    assert re.search(r'alt="[^"]{20,}"', image[0])


def test_each_way_in_says_what_it_leads_to() -> None:
    page = (static_dir() / "index.html").read_text()
    ways = page[page.index('class="ways"') : page.index('id="homefile"')]
    found = re.findall(r'<li><button id="(\w+)".*?</button>\s*<span>([^<]{15,})</span></li>', ways)
    assert [name for name, _ in found] == ["homenew", "homeopenfile", "homedemo", "homeguide"]
