"""Write report.html: the card, then plans, player and report with pictures inside; one file that needs no network."""

import base64
import html
import re
from importlib import resources
from pathlib import Path

from markdown_it import MarkdownIt

from aircl_jax.reports import plans
from aircl_jax.runs.directory import CARD_WORDS, FIGURES, PLANS, REPORT
from aircl_jax.runs.readers import read_json

PLAYER = "watch.html"  # within the figures, once `experiments.watch` has written it
FOLDED = ("Every seed",)  # sections that are opened at a touch
# A picture alone in its paragraph, and the paragraph after it, which is its caption.
_FIGURE = re.compile(r'<p><img src="([^"]+)" alt="([^"]*)" ?/?></p>\s*<p>(.*?)</p>', re.DOTALL)
_TAGS = re.compile(r"<[^>]+>")


def page_of(folder: Path, report: str | None = None) -> str:
    """Write the page of a finished run from the files in its folder, report.md among them where no other text is given."""
    if report is None:
        report = (folder / REPORT).read_text(encoding="utf-8")
    title = report.partition("\n")[0].removeprefix("# ")
    head, body = _sections(_with_figures(_as_html(report), folder))
    card, player, planned = folder / CARD_WORDS, folder / FIGURES / PLAYER, read_json(folder / PLANS)
    has_plans = planned is not None and plans.is_plans(planned)
    first = ["Card"] * card.exists() + ["Plans"] * has_plans + ["Film"] * player.exists()
    parts = [head, _contents([*first, *(name for name, _ in body)])]
    if card.exists():
        _, of_card = _sections(_as_html(card.read_text(encoding="utf-8")))
        parts += ['<div id="card">', *(_titled(name, text) for name, text in of_card), "</div>"]
    if planned is not None and has_plans:
        parts.append(_titled("Plans", plans.as_html(planned)))
    if player.exists():
        parts.append(_titled("Film", _framed(player)))
    for name, text in body:
        section = f"<summary>{name}</summary>{text}"
        parts.append(f'<details id="{_anchor(name)}">{section}</details>' if name in FOLDED else _titled(name, text))
    template = (resources.files("aircl_jax.reports") / "page.html").read_text(encoding="utf-8")
    before, after = template.split("{{BODY}}")
    return before.replace("{{TITLE}}", html.escape(title)) + "\n".join(parts) + after


def _as_html(text: str) -> str:
    """Turn Markdown into HTML; HTML within it is shown as text, and wide tables scroll by themselves."""
    made = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    return made.replace("<table>", '<div class="table"><table>').replace("</table>", "</table></div>")


def _sections(text: str) -> tuple[str, list[tuple[str, str]]]:
    """Split HTML at its second headings: what comes before the first, and (name, HTML) of each."""
    head, *rest = re.split(r"<h2>(.*?)</h2>", text)
    return head, list(zip(rest[::2], rest[1::2], strict=True))


def _with_figures(text: str, folder: Path) -> str:
    """Put pictures inside, each with its caption as its alternative text."""

    def figure(found: re.Match[str]) -> str:
        source, name, caption = found.groups()
        path = folder / FIGURES / Path(html.unescape(source)).name
        if not path.is_file():
            return f"<p>{name} is missing: {caption}</p>"
        data = base64.b64encode(path.read_bytes()).decode()
        words = html.escape(html.unescape(_TAGS.sub("", caption)))
        picture = f'<img src="data:image/png;base64,{data}" alt="{words}" loading="lazy">'
        return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"

    return _FIGURE.sub(figure, text)


def _framed(player: Path) -> str:
    """Put the player in a frame of its own, which may run its script and reach nothing else."""
    content = html.escape(player.read_text(encoding="utf-8"))
    return f'<iframe title="demonstrations beside the policy" sandbox="allow-scripts" srcdoc="{content}"></iframe>'


def _contents(names: list[str]) -> str:
    links = (f'<a href="#{_anchor(name)}">{name}</a>' for name in names)
    return f"<nav>{' '.join(links)}</nav>"


def _titled(name: str, text: str) -> str:
    return f'<h2 id="{_anchor(name)}">{name}</h2>{text}'


def _anchor(name: str) -> str:
    return re.sub(r"\W+", "-", _TAGS.sub("", name).lower())
