"""The documentation site: it builds without a warning, shows every public name, and has words for every picture."""

import importlib.util
import json
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

import aircl_jax
import envs

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-docs" / "bin" / "python"  # of `make docs`
MARKDOWN = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FEWEST_WORDS = 4  # of an alternative text, which says what is to be seen


def pictures(text: str) -> list[tuple[str, str]]:
    return re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", text)


def test_every_picture_of_a_page_has_words_for_those_who_do_not_see_it():
    shown = {(path.name, target): words for path in MARKDOWN for words, target in pictures(path.read_text())}
    assert len(shown) >= 7
    assert [place for place, words in shown.items() if len(words.split()) < FEWEST_WORDS] == []
    assert not any("<img" in path.read_text() for path in MARKDOWN)


def test_every_picture_of_a_notebook_has_words_for_the_site():
    cells = [
        (path.stem, number, cell["metadata"])
        for path in (ROOT / "notebooks").glob("*.ipynb")
        for number, cell in enumerate(json.loads(path.read_text())["cells"])
        if any("image/png" in output.get("data", {}) for output in cell.get("outputs", []))
    ]
    assert len(cells) >= 8
    words = {(stem, number): told.get("mystnb", {}).get("image", {}).get("alt", "") for stem, number, told in cells}
    assert [place for place, alt in words.items() if len(alt.split()) < FEWEST_WORDS] == []


@pytest.mark.parametrize("package", [aircl_jax, envs])
def test_every_public_name_has_a_place_in_the_reference(package):
    pages = "".join(path.read_text() for path in (ROOT / "docs" / "api").glob("*.md"))
    shown = set(re.findall(r"^\.\. (?:auto\w+|py:data):: (\S+)", pages, flags=re.MULTILINE))
    names = set(package.__all__) - ({"ENVS", "make_env"} if package is aircl_jax else set())  # handed on from `envs`
    assert {name for name in names if f"{package.__name__}.{name}" not in shown} == set()


def test_every_page_is_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text()
    listed = set(re.findall(r"^(\.\./\w+|[\w/]+)$", index, flags=re.MULTILINE))
    pages = {str(path.relative_to(ROOT / "docs").with_suffix("")) for path in (ROOT / "docs").rglob("*.md")} - {"index"}
    assert pages <= listed


def test_docstrings_are_shown_as_they_read():
    spec = importlib.util.spec_from_file_location("site_settings", ROOT / "docs" / "conf.py")
    assert spec is not None and spec.loader is not None
    settings = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(settings)
    lines = ["δ̄ = δ_seq · |x|*, of `a_b*` and x_ alone"]
    settings.plain(None, "", "", None, None, lines)
    assert lines == [r"δ̄ = δ_seq · \|x\|\*, of ``a_b*`` and x\_ alone"]


class Images(HTMLParser):
    """The alternative texts of a page's pictures."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.found.append(dict(attrs).get("alt") or "")


@pytest.mark.slow
@pytest.mark.skipif(not PYTHON.exists(), reason="no .venv-docs: run `make docs` first")
def test_the_site_builds_without_a_warning_and_its_pictures_have_words(tmp_path):
    words = ("-q", "-W", "--keep-going", "-c", "docs", "-d", str(tmp_path / "trees"), ".", str(tmp_path / "site"))
    built = subprocess.run([str(PYTHON), "-m", "sphinx", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert not (ROOT / "jupyter_execute").exists()
    site = tmp_path / "site"
    assert "I have a robot" in (site / "docs" / "index.html").read_text()
    assert "Make the shield of a finished run" in (site / "docs" / "api" / "transfer.html").read_text()
    notebook = Images((site / "notebooks" / "01_gridworld.html").read_text()).found
    assert len(notebook) >= 8
    assert min(len(alt.split()) for alt in notebook) >= FEWEST_WORDS
