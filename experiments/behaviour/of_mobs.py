"""Ask of simulated mobs, whose constraint is known, how many of the forbidden changes are found."""

import json
import shlex
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from aircl_jax.algorithm.measures import auroc
from aircl_jax.analysis.recovered import expected
from aircl_jax.animals.changes import Changes, avoided_changes, expected_times, fit_ordinary, ordinary_share
from aircl_jax.animals.going import ORDINARY, choices_of
from aircl_jax.reports import markdown
from aircl_jax.storage import write_whole
from envs.animals import simulated_meerkats
from envs.animals.full.steps import NONE, Recordings, recordings_of
from envs.animals.windows import code_rows
from experiments.behaviour.settings import Settings
from experiments.shared.commits import current_commit
from experiments.shared.paired_tests import spread

SIZES = (100, 300, 900)  # windows
CHOOSING = 100  # seed of the mob on which scatter and prior are chosen; no other number is of it
SCATTERS, PRIORS = (0.7, 1.0, 1.5), (0.05, 0.1, 0.15, 0.2)
CHOSEN_AT = 300  # windows
HIDDEN = 0.2  # share of the pairs that were made
FALSE_COST = 2.0  # found changes that one false alarm outweighs, in the choice
COUNTED = 5.0  # expected times above which counting calls a change that was never made avoided


class Mob(NamedTuple):
    recordings: Recordings
    forbidden: Bool[np.ndarray, "C C"]
    possible: Bool[np.ndarray, "C C"]
    reward: Float[np.ndarray, "C C"]


def mob(seed: int) -> Mob:
    """Simulate a mob, as tables would give it."""
    tracks = simulated_meerkats.simulated_tracks(seed)
    recordings = recordings_of(code_rows(tracks, simulated_meerkats.MAPPING), simulated_meerkats.MAPPING, simulated=True)
    truth = simulated_meerkats.truth()
    possible = ~truth.structural & ~np.eye(len(truth.forbidden), dtype=bool)
    return Mob(recordings, truth.forbidden, possible, truth.reward)


def seen_in(one: Mob, size: int, seed: int) -> Float[np.ndarray, " n"]:
    """Weight the changes by whether one of `size` random windows holds them."""
    steps = one.recordings.steps
    window = steps.window[steps.code != steps.following]
    chosen = np.random.default_rng(seed).permutation(int(steps.window.max()) + 1)[:size]
    return (np.isin(window, chosen) & (window != NONE)).astype(np.float64)


def scores(one: Mob, found: Changes) -> dict[str, Float[np.ndarray, "C C"]]:
    """Score how avoided each change is, by the test and by counting."""
    made = found.made
    chance = expected(made.astype(np.int64), ~one.possible & ~np.eye(len(made), dtype=bool))
    return {
        "Bayes factor": found.log_bayes,
        "counting: −(n + ¼) / (expected + ¼)": -(made + 0.25) / (chance + 0.25),
        "counting: −n / expected": -made / np.maximum(chance, 1e-9),
        "counting: − log share": -np.log((made + 0.1) / (made.sum(axis=1, keepdims=True) + 0.1 * made.shape[1])),
    }


def judged(one: Mob, size: int, seed: int, scatter: float, prior: float) -> dict[str, float]:
    """Test all changes of some windows, and compare with the truth."""
    choices = choices_of(one.recordings, ORDINARY)
    weight = choices.weighed(seen_in(one, size, seed))
    found = avoided_changes(choices, one.recordings, weight, scatter, prior)
    numbers = {
        f"AUROC, {name}": _auroc(values[one.possible], one.forbidden[one.possible])
        for name, values in scores(one, found).items()
    }
    chance = expected(found.made.astype(np.int64), ~one.possible & ~np.eye(len(found.made), dtype=bool))
    counted = (found.made == 0) & (chance >= COUNTED) & one.possible
    for name, flagged in (("flagged", found.flagged & one.possible), ("counting: n = 0, expected ≥ 5", counted)):
        numbers[f"found of {int(one.forbidden.sum())}, {name}"] = float((flagged & one.forbidden).sum())
        numbers[f"false, {name}"] = float((flagged & ~one.forbidden).sum())
    return numbers


def hidden_pairs(one: Mob, size: int, seed: int) -> dict[str, float]:
    """Hide a fifth of the pairs that were made, and correlate what is expected of them with the true reward.

    The test's expectation is of place and activity, counting's of how often each activity begins.
    """
    choices = choices_of(one.recordings, ORDINARY)
    weight = choices.weighed(seen_in(one, size, seed))
    made = np.zeros(one.possible.shape)
    np.add.at(made, (choices.left, choices.chosen), weight)
    hidden = (made > 0) & one.possible & (np.random.default_rng(seed).random(made.shape) < HIDDEN)
    kept = weight * ~hidden[choices.left, choices.chosen]
    share = ordinary_share(choices, fit_ordinary(choices, kept, hidden), hidden)
    out_of = np.bincount(choices.left, weight, len(made))[:, None]
    model = expected_times(choices, share, weight) / np.maximum(out_of, 1.0)
    counts = np.where(hidden, 0.0, made)
    counting = expected(counts.astype(np.int64), ~one.possible & ~np.eye(len(made), dtype=bool))
    counting = counting / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    judged = hidden & (model > 0) & (counting > 0)
    return {
        f"correlation with the reward of hidden pairs, {name}": float(
            np.corrcoef(np.log(share[judged]), one.reward[judged])[0, 1]
        )
        for name, share in (("expected", model), ("counting", counting))
    }


def _auroc(score: Float[np.ndarray, " K"], positive: Bool[np.ndarray, " K"]) -> float:
    return float(auroc(jnp.asarray(score), jnp.asarray(positive, float), jnp.asarray(~positive, float)))


def choose() -> tuple[float, float]:
    """Choose scatter and prior on one mob: most found, less what false alarms cost."""
    one = mob(CHOOSING)

    def worth(pair: tuple[float, float]) -> float:
        numbers = judged(one, CHOSEN_AT, CHOOSING, *pair)
        return (
            next(value for name, value in numbers.items() if name.startswith("found") and "flagged" in name)
            - FALSE_COST * numbers["false, flagged"]
        )

    return max(((scatter, prior) for scatter in SCATTERS for prior in PRIORS), key=worth)


def run(settings: Settings, words: Sequence[str]) -> dict[str, Any]:
    """Choose on one mob, judge on the others, write the page."""
    began, commit = time.perf_counter(), current_commit()
    scatter, prior = choose()
    by_size: dict[int, list[Mapping[str, float]]] = {size: [] for size in SIZES}
    for seed in range(settings.mobs):
        one = mob(seed)
        for size in SIZES:
            by_size[size].append(judged(one, size, seed, scatter, prior) | hidden_pairs(one, size, seed))
    names = list(by_size[SIZES[0]][0])
    command = shlex.join(["python", "-m", "experiments.behaviour", *words])
    rows = [
        (
            name,
            *(
                spread([numbers[name] for numbers in by_size[size]], 1 if name.startswith(("found", "false")) else 3)
                for size in SIZES
            ),
        )
        for name in names
    ]
    seconds = time.perf_counter() - began
    page = markdown.paragraphs(
        "# Forbidden changes of simulated mobs",
        f"`{command}`, commit {commit}, {seconds:.0f} s. {settings.mobs} mobs, mean ± std; scatter σ = {scatter:g} and prior "
        f"{prior:g} chosen on one more mob.",
        markdown.table(("", *(f"{size} windows" for size in SIZES)), rows),
        "AUROC is over all possible changes.",
    )
    folder = settings.folder
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "report.md", page)
    numbers = {
        "command": command,
        "commit": commit,
        "scatter": scatter,
        "prior": prior,
        "mobs": {str(size): [dict(one) for one in found] for size, found in by_size.items()},
        "seconds": round(seconds, 1),
    }
    write_whole(folder / "numbers.json", json.dumps(numbers, indent=1, ensure_ascii=False) + "\n")
    print(page)
    return numbers
