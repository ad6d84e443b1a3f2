"""Run the study of the mice and write its page, figure and arrays."""

import json
import shlex
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from aircl_jax.figures.animals import modes as mode_figures
from aircl_jax.figures.style import DPI, STYLE
from aircl_jax.reports import card, markdown
from aircl_jax.storage import write_whole
from envs import Maze
from envs.animals.data_folder import command_prefix
from envs.animals.labyrinth import HOME, MARKS, WATER_PORT, layout, load
from envs.options import LabyrinthOptions
from experiments.behaviour.maze_study import ENTRANCE, LEAST_SHARE, MazeStudy, study
from experiments.behaviour.report import gain
from experiments.behaviour.settings import Settings
from experiments.shared.commits import current_commit


def run(settings: Settings, words: Sequence[str]) -> dict[str, Any]:
    """Study the mice and write everything; return the numbers."""
    began, commit = time.perf_counter(), current_commit()
    mice = load(LabyrinthOptions(data=settings.data))
    found = study(mice)
    seconds = time.perf_counter() - began
    command = command_prefix(settings.data, mice.simulated) + shlex.join(["python", "-m", "experiments.behaviour", *words])
    folder = settings.folder
    folder.mkdir(parents=True, exist_ok=True)
    title = ("Simulated mice" if mice.simulated else "Mice") + " in the labyrinth: habits with places"
    with mpl.rc_context(STYLE):
        drawing = mode_figures.draw(found.modes.reward, found.modes.share, Maze(layout(), mice.successor, MARKS))
        drawing.figure.savefig(folder / f"{drawing.name}.png", dpi=DPI)
    about = f"`{command}`, commit {commit}, {seconds:.0f} s."
    figure = f"![{drawing.name}]({drawing.name}.png)\n\n{drawing.caption}"
    write_whole(folder / "report.md", markdown.paragraphs(f"# {title}", about, *_page(found), figure))
    entries = maze_card(found)
    write_whole(folder / "card.json", card.as_json(entries))
    write_whole(folder / "card.md", card.as_markdown(entries, title))
    numbers = numbers_of(found) | {"command": command, "commit": commit, "seconds": round(seconds, 1)}
    write_whole(folder / "numbers.json", json.dumps(numbers, indent=1) + "\n")
    _save(folder, found)
    print(card.closing(entries))
    print(folder / "report.md")
    return numbers


def _save(folder: Path, found: MazeStudy) -> None:
    modes, ways = found.modes, found.ways
    np.savez_compressed(
        folder / "recovered.npz",
        reward=modes.reward,
        habits=modes.habits,
        habit_names=np.array(ways.habit_names),
        switch=modes.switch,
        share=modes.share,
    )


def _page(found: MazeStudy) -> Iterator[str]:
    yield "## Does it beat counting?"
    rows = [(name, f"{nats:.4f}") for name, nats in found.nats.items()]
    yield markdown.table(("held-out nats a move, ten consecutive blocks of recordings", ""), rows)
    orders = ", ".join(map(str, found.tuned_orders))
    yield (
        f"Gain over the second-order chain {gain(found.second)} blocks; over the tuned back-off chain {gain(found.tuned)}. Its "
        f"order and pseudo-count are chosen inside the training recordings (orders {orders})."
    )
    yield "With few recordings to learn from, judged on the same two tenths:"
    rows = [
        (
            str(size),
            *(f"{value:.4f}" for value in values.mean(axis=1)),
            *(f"{d(values[1] - values[0]):+.4f}" for d in (min, max)),
        )
        for size, values in found.by_size.items()
    ]
    yield markdown.table(("recordings", "tuned chain", "modes", "least gain", "greatest gain"), rows)
    yield "## Where does it go?"
    rows = [
        (str(one.fold), f"{one.start} {one.seed}", f"{one.nats:.4f}", f"{one.held_out:.4f}", str(one.water), str(one.home))
        for one in found.starts
    ]
    yield markdown.table(("block", "start", "nats, held in", "held out", "rank of the water port", "rank of home"), rows)
    yield (
        f"Ranks are the best over modes of at least {LEAST_SHARE:.0%} of the steps, of 127 nodes by reward of arriving. EM "
        "ends in local optima; the start of the best held-in likelihood is kept. The named start has, in hindsight, one mode "
        "on the way to the water port and one on the way home."
    )
    rows = [
        (str(number), str(water), str(home), f"{nats:.4f}")
        for number, (water, home, nats) in zip((3, 4, 5), found.home_ranks, strict=True)
    ]
    yield f"Without habits at depths below {ENTRANCE}, which can do the work of a reward of home (one tenth held out):"
    yield markdown.table(("modes", "rank of the water port", "rank of home", "nats, held out"), rows)
    yield "## What does it never do?"
    made, possible = found.share_made
    yield f"{made} of {possible} moves that exist were made: there is nothing to find."


def maze_card(found: MazeStudy) -> dict[str, Any]:
    """Make the card of the mice."""
    modes = found.modes
    wants = []
    for mode in np.argsort(-modes.share):
        node = int(modes.reward[mode].argmax())
        name = {WATER_PORT: "the water port", HOME: "home"}.get(node, f"node {node}")
        weight, second = (float(value) for value in np.sort(modes.reward[mode])[::-1][:2])
        what = f"{name}, in a mode of {modes.share[mode]:.0%} of the moves (the next place {second:.1f})"
        wants.append({"what": what, "weight": weight, "spread": None})
    made, possible = found.share_made
    return {
        "wants": sorted(wants, key=lambda entry: -entry["weight"]),
        "never": [],
        "cannot_tell": [
            f"{made} of {possible} moves that exist were made: no constraint can be found.",
            "The modes are of one start of EM; other starts end elsewhere (report.md), so a weight has no spread here.",
            "Places and habits stand in for each other: going outwards at the entrance is worth a reward of home.",
            "The reward is of the next node alone. Whether the mice plan ahead is not shown.",
        ],
        "separable": True,
    }


def numbers_of(found: MazeStudy) -> dict[str, Any]:
    """Collect the numbers of the page."""
    return {
        "nats": found.nats,
        "over_second_order": found.second._asdict(),
        "over_tuned": found.tuned._asdict(),
        "tuned_orders": found.tuned_orders,
        "starts": [one._asdict() for one in found.starts],
        "kept": found.kept,
        "by_size": {str(size): values.tolist() for size, values in found.by_size.items()},
        "without_entrance": found.home_ranks,
        "moves_made": found.share_made,
    }
