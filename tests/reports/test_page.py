"""The HTML report: one file without network, the card first, every picture with words, nothing of a text as HTML."""

import html
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from aircl_jax.reports import markdown
from aircl_jax.reports.card import as_markdown
from aircl_jax.reports.page import page_of
from aircl_jax.reports.run_report import report

CARD = {
    "wants": [{"what": "one row further down", "weight": 1.5, "spread": 0.25}],
    "never": [{"what": "entering cell [1, 1]", "limit": None, "spread": 1.0, "tempted": 31.0, "done": 0.0, "how": "δ₁ 0.01"}],
    "cannot_tell": ["Not tested: [5, 0] (0.1)."],
    "separable": True,
}
WIDE = {name: {"mean": 0.5, "std": 0.1, "per_seed": [0.123] * 10} for name in ("return", "violation_rate", "goal_rate")}
SUMMARY = {
    "env": "gridworld",
    "method": "aircl_contrast",
    "seeds": list(range(10)),
    "iterations": 3,
    "env_steps": 100,
    "wall_s": 1.0,
    "compile_s": 0.5,
    "env_steps_per_s": 10.0,
    "metrics": WIDE,
}
BROWSER = next(filter(None, map(shutil.which, ("chromium-headless-shell", "chromium", "google-chrome"))), None)


class Read(HTMLParser):
    """What a page refers to, its pictures' words and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.pictures: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        given = {name: value or "" for name, value in attrs}
        self.tags.append(tag)
        self.addresses += [given[name] for name in ("src", "href", "data") if name in given]
        if tag == "img":
            self.pictures.append(given["alt"])

    def handle_data(self, data):
        self.text += data


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "figures").mkdir()
    picture = tmp_path / "figures" / "maps.png"
    image.imsave(picture, np.zeros((4, 900, 3)))
    alarms = ["δ̄ over-flags: <script>alert(1)</script>"]
    text = report(SUMMARY, alarms, [(picture, "f and δ̄ of “every” cell, *mean* of 10 seeds.")], "python -m experiments.run")
    (tmp_path / "report.md").write_text(text, encoding="utf-8")
    (tmp_path / "card.md").write_text(as_markdown(CARD, "aircl_contrast on gridworld"), encoding="utf-8")
    return tmp_path


def test_the_card_comes_before_alarms_figures_and_measures(folder):
    text = Read(page_of(folder)).text
    order = ["What it wants", "one row further down", "What it does not do", "31 times", "cannot tell", "Alarms", "f and δ̄ of"]
    places = [text.rindex(words) for words in [*order, "Measures at the end", "Every seed"]]
    assert places == sorted(places)
    assert "aircl_contrast on gridworld" in text and "0.5 ± 0.1" in text


def test_nothing_is_fetched_and_every_picture_has_its_caption_as_words(folder):
    page = Read(page_of(folder))
    assert all(address.startswith(("data:image/png;base64,", "#")) for address in page.addresses)
    assert page.pictures == ["f and δ̄ of “every” cell, mean of 10 seeds."]
    assert not re.search(r"https?://|@import|url\(", page_of(folder))


def test_links_within_the_page_lead_somewhere(folder):
    page = page_of(folder)
    targets = [address[1:] for address in Read(page).addresses if address.startswith("#")]
    assert len(targets) > 4
    assert set(targets) <= set(re.findall(r'id="([^"]+)"', page))


def test_texts_are_shown_and_never_run(folder):
    page = Read(page_of(folder))
    assert "script" not in page.tags
    assert "<script>alert(1)</script>" in page.text


def test_a_missing_card_or_picture_costs_nothing_else(folder):
    (folder / "card.md").unlink()
    (folder / "figures" / "maps.png").unlink()
    text = Read(page_of(folder)).text
    assert "maps is missing: f and δ̄" in text and "Measures at the end" in text and "Card" not in text


def test_the_player_is_inside_once_it_was_written_in_a_frame_that_reaches_nothing(folder):
    (folder / "figures" / "watch.html").write_text("<!doctype html><title>Film</title><p>swims & 'walks'", encoding="utf-8")
    page = page_of(folder)
    [frame] = re.findall(r'<iframe [^>]*sandbox="allow-scripts" srcdoc="([^"]*)">', page)
    assert html.unescape(frame).endswith("<p>swims & 'walks'")
    assert '<a href="#film">' in page


def test_another_text_is_taken_in_place_of_the_file(folder):
    assert "Quite new" in page_of(folder, markdown.paragraphs("# Title", "Quite new."))


def in_browser(page: Path) -> str:
    """What a browser makes of a file, its scripts run."""
    words = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=4000", "--dump-dom", page.as_uri())
    return subprocess.run([str(BROWSER), *words], capture_output=True, text=True, check=True, timeout=120).stdout


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no headless Chromium")
@pytest.mark.parametrize("width", [360, 1200])
def test_a_browser_reads_the_card_at_the_width_of_a_phone_and_of_a_desk(folder, width):
    outer = folder / "outer.html"
    measure = (
        "<script>onload = () => { const page = document.querySelector('iframe').contentDocument;"
        "const card = page.querySelector('#card');"
        "document.title = page.documentElement.scrollWidth + '|' + card.getBoundingClientRect().top + '|' +"
        " page.querySelector('img').complete + '|' + card.innerText.replace(/\\s+/g, ' '); }</script>"
    )
    framed = f'<iframe style="width: {width}px; height: 800px; border: 0" srcdoc="{html.escape(page_of(folder))}"></iframe>'
    outer.write_text(f'<!doctype html><meta charset="utf-8"><title></title>{framed}{measure}', encoding="utf-8")
    [found] = re.findall(r"<title>(.*?)</title>", in_browser(outer), flags=re.DOTALL)[:1]
    wide, top, complete, words = html.unescape(found).split("|", maxsplit=3)
    assert int(wide) <= width  # nothing but tables, by themselves, scrolls sideways
    assert float(top) < 400  # the card is on the first screen
    assert complete == "true"
    assert "entering cell [1, 1]" in words and "What it wants" in words
