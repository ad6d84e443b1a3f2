"""Draw the plans of a run on a grid for its page: one picture each, of which the reader chooses; no script is needed."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

CELL = 60  # of a picture's own units
NAMES = ("both", "reward", "constraint", "goal")  # those that page.html has a rule for
FIELDS = {
    *("name", "title", "about", "start", "ends", "flagged", "forbidden", "walls"),
    *("paths", "violating", "arrives", "violates"),
}
KEY = (
    "Outlined: truly forbidden cells. Hatched: cells that the learned constraint flags, where the plan knows it. Orange: paths "
    "through a truly forbidden cell. S the start, G where it ends."
)


def is_plans(found: Any) -> bool:
    """Whether this is what plans.json holds, and not something damaged."""
    if not isinstance(found, dict) or not {"seed", "size", "plans"} <= set(found):
        return False
    plans = found["plans"]
    if not isinstance(plans, list) or not plans:
        return False
    return all(isinstance(plan, dict) and set(plan) >= FIELDS and plan["name"] in NAMES for plan in plans)


def as_html(found: Mapping[str, Any]) -> str:
    """Write the choice and its pictures; the first one is shown until another is chosen."""
    buttons = [
        f'<input type="radio" name="plan" id="plan-{plan["name"]}"{" checked" * (place == 0)}>'
        f'<label for="plan-{plan["name"]}">{html.escape(plan["title"])}</label>'
        for place, plan in enumerate(found["plans"])
    ]
    figures = [_figure(plan, found["size"], found["seed"]) for plan in found["plans"]]
    return f'<fieldset class="plans"><legend>Plan on</legend>{"".join(buttons)}{"".join(figures)}</fieldset>'


def _figure(plan: Mapping[str, Any], size: int, seed: int) -> str:
    words = caption(plan, seed)
    picture = _picture(plan, size, f"{len(plan['paths'])} paths on a {size} by {size} grid. {words}")
    return f'<figure class="plan-{plan["name"]}">{picture}<figcaption>{html.escape(words)} {KEY}</figcaption></figure>'


def caption(plan: Mapping[str, Any], seed: int) -> str:
    """Say what was planned on and what comes of it, exactly."""
    found = [f"{_percent(plan['violates'])} of the episodes enter a truly forbidden cell"]
    if plan["arrives"] is not None:
        found.insert(0, f"{_percent(plan['arrives'])} of the episodes end in the goal")
    return f"{plan['title']}: {plan['about']}. {', '.join(found)}. Seed {seed}, planned greedily with the true dynamics."


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _picture(plan: Mapping[str, Any], size: int, words: str) -> str:
    """Draw cells, then paths, each shifted a little, violating ones last, then letters."""
    hatch = f"hatch-{plan['name']}"
    cells = [_cell(cell, size, "line") for cell in range(size**2)]
    cells += [_cell(cell, size, "wall") for cell in plan["walls"]]
    cells += [_cell(cell, size, "flagged", f' fill="url(#{hatch})"') for cell in plan["flagged"]]
    cells += [_cell(cell, size, "forbidden") for cell in plan["forbidden"]]
    shifts = np.random.default_rng(0).uniform(-0.3, 0.3, (len(plan["paths"]), 2))
    order = sorted(range(len(plan["paths"])), key=lambda place: plan["violating"][place])
    paths = [_path(plan["paths"][place], size, shifts[place].tolist(), plan["violating"][place]) for place in order]
    letters = [_letter(cell, size, "G") for cell in plan["ends"]]
    letters += [] if plan["start"] is None else [_letter(plan["start"], size, "S")]
    side = size * CELL
    pattern = (
        f'<defs><pattern id="{hatch}" width="8" height="8" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
        '<line x1="0" y1="0" x2="0" y2="8" class="hatch"/></pattern></defs>'
    )
    return (
        f'<svg viewBox="-2 -2 {side + 4} {side + 4}" role="img" aria-label="{html.escape(words)}">'
        f"{pattern}{''.join(cells)}{''.join(paths)}{''.join(letters)}</svg>"
    )


def _place(cell: int, size: int) -> tuple[int, int]:
    """Left and upper edge of a cell."""
    row, column = divmod(cell, size)
    return CELL * column, CELL * row


def _cell(cell: int, size: int, kind: str, more: str = "") -> str:
    x, y = _place(cell, size)
    inset = 3 if kind == "forbidden" else 0
    side = CELL - 2 * inset
    return f'<rect x="{x + inset}" y="{y + inset}" width="{side}" height="{side}" class="{kind}"{more}/>'


def _path(cells: Sequence[int], size: int, shift: Sequence[float], violating: bool) -> str:
    """Draw a path once around each cell that it stays in."""
    moved = [cell for place, cell in enumerate(cells) if place == 0 or cell != cells[place - 1]]
    corners = [_place(cell, size) for cell in moved]
    points = " ".join(f"{x + CELL * (0.5 + shift[0]):.0f},{y + CELL * (0.5 + shift[1]):.0f}" for x, y in corners)
    return f'<polyline points="{points}" class="{"path bad" if violating else "path"}"/>'


def _letter(cell: int, size: int, letter: str) -> str:
    x, y = _place(cell, size)
    return f'<text x="{x + CELL // 2}" y="{y + CELL // 2}" dy="0.36em" text-anchor="middle">{letter}</text>'
