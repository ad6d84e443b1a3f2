"""The plans of a grid's run are in its page: the reader chooses, without a script, and each picture has words."""

import html
import json
import re

import pytest

from aircl_jax.reports import plans
from aircl_jax.reports.page import page_of
from tests.reports.test_page import BROWSER, Read, folder, in_browser

__all__ = ["folder"]  # a fixture


def plan(name: str, **changed):
    made = {
        "name": name,
        "title": f"Title of {name}",
        "about": "some <b>words</b>",
        "start": 0,
        "ends": [8],
        "flagged": [4],
        "forbidden": [4, 5],
        "walls": [6],
        "paths": [[0, 1, 1, 2], [0, 3, 4, 5]],
        "violating": [False, True],
        "arrives": 0.25,
        "violates": 0.5,
    }
    return made | changed


FOUND = {"seed": 7, "size": 3, "plans": [plan("both"), plan("reward", flagged=[]), plan("goal", arrives=None, start=None)]}


@pytest.fixture
def page(folder):
    (folder / "plans.json").write_text(json.dumps(FOUND), encoding="utf-8")
    return page_of(folder)


def test_there_is_a_button_and_a_picture_with_words_for_each_plan_and_no_script(page):
    assert re.findall(r'<input type="radio" name="plan" id="plan-(\w+)"( checked)?>', page) == [
        ("both", " checked"),
        ("reward", ""),
        ("goal", ""),
    ]
    words = re.findall(r'<svg [^>]*role="img" aria-label="([^"]*)"', page)
    assert len(words) == 3
    assert html.unescape(words[0]) == (
        "2 paths on a 3 by 3 grid. Title of both: some <b>words</b>. 25.0 % of the episodes end in the goal, 50.0 % of the "
        "episodes enter a truly forbidden cell. Seed 7, planned greedily with the true dynamics."
    )
    assert "end in the goal" not in words[2]
    assert "script" not in Read(page).tags and "<b>words" not in page
    assert '<a href="#plans">' in page and all(f"#plan-{name}:checked ~ .plan-{name}" in page for name in plans.NAMES)


def test_cells_and_paths_are_where_they_belong(page):
    picture = re.findall(r"<svg.*?</svg>", page)[0]
    assert re.findall(r'x="(\d+)" y="(\d+)"[^>]*class="flagged"', picture) == [("60", "60")]
    assert re.findall(r'x="(\d+)" y="(\d+)"[^>]*class="forbidden"', picture) == [("63", "63"), ("123", "63")]
    assert re.findall(r'x="(\d+)" y="(\d+)"[^>]*class="wall"', picture) == [("0", "120")]
    paths = re.findall(r'points="([^"]*)" class="([^"]*)"', picture)
    assert [kind for _, kind in paths] == ["path", "path bad"]
    assert [len(points.split()) for points, _ in paths] == [3, 4]  # a cell where the path stays is one corner
    assert re.findall(r">([SG])</text>", picture) == ["G", "S"]


@pytest.mark.parametrize(
    "broken", ["{", "[]", '{"seed": 0, "size": 3, "plans": [{"name": "both"}]}', '{"seed": 0, "size": 3, "plans": 1}']
)
def test_a_damaged_file_costs_the_plans_alone(folder, broken):
    (folder / "plans.json").write_text(broken, encoding="utf-8")
    page = page_of(folder)
    assert "<fieldset" not in page and "What it wants" in page


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no headless Chromium")
@pytest.mark.parametrize("width", [360, 1200])
def test_a_browser_shows_the_plan_that_is_chosen(folder, page, width):
    ask = (
        "<script>onload = () => { const page = document.querySelector('iframe').contentDocument; const seen = [];"
        "const look = () => seen.push([...page.querySelectorAll('.plans figure')].filter((one) => one.offsetHeight > 0)"
        ".map((one) => one.className + ' ' + (one.querySelector('svg').getBoundingClientRect().width > 200)).join('+'));"
        "look(); for (const name of ['reward', 'goal', 'both']) {"
        " page.querySelector(`label[for=plan-${name}]`).click(); look(); }"
        "document.title = page.documentElement.scrollWidth + '|' + seen.join('|'); }</script>"
    )
    framed = f'<iframe style="width: {width}px; height: 800px; border: 0" srcdoc="{html.escape(page)}"></iframe>'
    outer = folder / "outer.html"
    outer.write_text(f'<!doctype html><meta charset="utf-8"><title></title>{framed}{ask}', encoding="utf-8")
    [found] = re.findall(r"<title>(.*?)</title>", in_browser(outer), flags=re.DOTALL)[:1]
    wide, *shown = html.unescape(found).split("|")
    assert int(wide) <= width
    assert shown == ["plan-both true", "plan-reward true", "plan-goal true", "plan-both true"]
