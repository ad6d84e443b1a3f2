"""Set the project's own results side by side: results/behaviour.md and .json, from the numbers that each run left."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax.animals.held_out import Gain
from aircl_jax.reports import markdown
from aircl_jax.storage import write_whole
from experiments.behaviour.report import gain

ENVS = ("meerkat", "labyrinth", "mobs")
Numbers = Mapping[str, Any]


def summarise(results: str) -> None:
    """Write RESULTS.json and RESULTS.md of the runs whose numbers are in the folder."""
    folder = Path(results)
    numbers = {
        env: json.loads((folder / env / "numbers.json").read_text(encoding="utf-8"))
        for env in ENVS
        if (folder / env / "numbers.json").is_file()
    }
    write_whole(folder.with_suffix(".json"), json.dumps(numbers, indent=1, ensure_ascii=False) + "\n")
    parts = [part for env, one in numbers.items() for part in (_head(env, one), *_LINES[env](one))]
    about = "Gains are in nats; in brackets 95 %, then in how many folds or recordings the gain is above 0."
    write_whole(folder.with_suffix(".md"), markdown.paragraphs("# What recorded animals want and avoid", about, *parts))


def _head(env: str, numbers: Numbers) -> str:
    page = f"[report]({Path('behaviour') / env / 'report.md'})"
    return f"## {env}\n\n`{numbers['command']}`, commit {numbers['commit']}; {page}"


def _meerkat(numbers: Numbers) -> Iterator[str]:
    rows = []
    for name, one in numbers["comparisons"].items():
        gains = {key: Gain(**one[key]) for key in ("per_step", "by_recording", "where")}
        rows.append((name, f"{one['chain']:.4f}", f"{one['model']:.4f}", *(gain(value) for value in gains.values())))
    yield markdown.table(
        ("steps judged", "smoothed chain", "model", "gain a step, folds", "recordings", "where to, a change"), rows
    )
    if numbers.get("nested"):
        one = numbers["nested"]
        folds, recordings = (gain(Gain(**one[key])) for key in ("per_step", "by_recording"))
        yield f"Features and ridges chosen on the other folds, windows: {folds} folds; {recordings} recordings."
    rows = [(one["context"], f"{one['nats']:.4f}", gain(Gain(**one["behind"]))) for one in numbers["counting"]]
    yield markdown.table(("counting, its pseudo-count best on the test", "nats", "the model's gain"), rows)
    rows = [
        (name, *(f"{one[key]:.1f}" for key in ("pairs", "made", "expected")), _rate(one))
        for name, one in numbers["halves"].items()
    ]
    yield markdown.table(("pairs of one half of the recordings", "pairs", "made on the other", "expected there", "rate"), rows)


def _rate(one: Numbers) -> str:
    return "—" if one["rate"] is None else f"{one['rate']:.2f}"


def _labyrinth(numbers: Numbers) -> Iterator[str]:
    yield markdown.table(("model", "nats a move"), [(name, f"{value:.4f}") for name, value in numbers["nats"].items()])
    second, tuned = (gain(Gain(**numbers[key])) for key in ("over_second_order", "over_tuned"))
    yield f"Modes less the second-order chain {second} blocks; less the tuned back-off chain {tuned} blocks."


def _mobs(numbers: Numbers) -> Iterator[str]:
    sizes = list(numbers["mobs"])
    rows = [
        (name, *(f"{np.mean([one[name] for one in numbers['mobs'][size]]):.3f}" for size in sizes))
        for name in numbers["mobs"][sizes[0]][0]
    ]
    yield markdown.table(("mean over mobs", *(f"{size} windows" for size in sizes)), rows)


_LINES = {"meerkat": _meerkat, "labyrinth": _labyrinth, "mobs": _mobs}
