"""Search settings by demonstrations that are held out: `python -m experiments.search train.ppo.learning_rate=1e-4:1e-2:log`."""

import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from aircl_jax.messages import say
from envs import ENVS
from envs.settings import updated
from experiments.cli.command import complain
from experiments.cli.hydra_cli import Composed, launch
from experiments.cli.hydra_settings import DEFAULT_ENV, QUIET, hydra_node, store
from experiments.cli.words import value_of

if TYPE_CHECKING:
    from aircl_jax.tuning.study import Trial

HELP = f"""Search settings of training on demonstrations, without the true reward or cost.

  python -m experiments.search env=swimmer train.ppo.learning_rate=0.0003:0.003:log train.adversary.num_steps=2:12
  python -m experiments.search env=gridworld train.encoder=attention,gru budget=6 demonstrations=mine.npz

What is searched is a setting of training with a range in place of its value:

train.NAME=LOW:HIGH      between two numbers, whole ones where the setting is one
train.NAME=LOW:HIGH:log  likewise, evenly in the logarithm
train.NAME=ONE,OTHER     one of a list

Every trial trains on a part of the demonstrations and is scored on those held out. The first trial is the defaults, where
the ranges hold them. The score is likelihood − moments + passing, each times its weight:

likelihood   mean log π(a|s) of held-out steps, a coordinate of the action
moments      how far means and mean squares of observation and action of fresh episodes are from the held-out ones:
             root mean square, in standard deviations of both mixed, at most 2
passing      share of held-out demonstrations that the learned feasibility lets pass, δ̄ ≥ ½

env             {", ".join(ENVS)}; env.NAME=VALUE changes a setting of it
budget          number of trials in all
held_out        share of the demonstrations that is held out
weights         weights.likelihood, weights.moments, weights.passing
seeds           number of seeds of each trial, from first_seed on
iterations      iterations of each trial
run_dir         folder of the search: study.journal of Optuna, training.npz, held_out.npz, search.md;
                resume=true goes on with a search that is there, overwrite=true starts again
method, contrast_prior, demonstrations and all other train.NAME=VALUE are those of experiments.run

$CONFIG
"""
SEARCHED = re.compile(r"train\.[\w.]+=")


@dataclass(frozen=True)
class SearchSettings:
    """The settings that belong neither to the environment (env.…) nor to training (train.…)."""

    method: str = "default"
    contrast_prior: Literal["method", "on", "off"] = "method"
    budget: int = 20
    held_out: float = 0.2
    weights: dict = field(default_factory=lambda: {"likelihood": 1.0, "moments": 1.0, "passing": 1.0})
    seeds: int = 1
    first_seed: int = 0
    iterations: int = 250
    run_dir: str = "runs/search/${hydra:runtime.choices.env}"
    demonstrations: str = "default"
    resume: bool = False
    overwrite: bool = False


# Of a search alone, or its own: no words of the run that is trained with what it finds.
_OF_A_SEARCH = ("budget", "held_out", "weights", "seeds", "first_seed", "run_dir", "resume", "overwrite")


def main(argv: Sequence[str] | None = None) -> int:
    """Search with these arguments, the command line's by default, and return the exit code; see docs/guide.md."""
    register()
    try:
        ranges, words = ranges_among(sys.argv[1:] if argv is None else list(argv))
    except ValueError as error:
        return complain(str(error))
    return launch(lambda composed: run(composed, ranges), "search", words)


def register() -> None:
    """Put the settings of a search into Hydra's store, beside those of a run."""
    store("search", {"defaults": _DEFAULTS, **asdict(SearchSettings()), "hydra": hydra_node("experiments.search", HELP)})


def run(composed: Composed, ranges: Mapping[str, Sequence[Any]]) -> None:
    """Search, with a line for each trial; print the table and the command that trains with the best settings."""
    values = dict(composed.values)
    env_settings, train_settings = values.pop("env"), values.pop("train")
    settings = updated(SearchSettings(), values)

    from aircl_jax.storage import disk, write_whole
    from aircl_jax.tuning.search import TABLE, THEN, search

    trials = f"{settings.budget} trials of {settings.iterations} iterations"
    say(f"{settings.method} on {composed.env}, {trials}, in {settings.run_dir}")
    found = search(
        composed.env,
        ranges=ranges,
        env_settings=env_settings,
        config=train_settings,
        on_trial=lambda trials, left: say(line(trials, settings.budget, left)),
        **vars(settings),
    )
    command = command_of(composed, found.best, settings)
    words = [
        found.table,
        *([] if found.has_defaults else ["The defaults lie outside the ranges and were not tried."]),
        "The best score is the greatest of several, so it flatters. To train with it, on all demonstrations and other seeds:",
        f"    {command}",
    ]
    path = Path(settings.run_dir) / TABLE
    with disk(path, THEN):
        write_whole(path, "\n\n".join([f"# Search on {composed.env}", *words]) + "\n")
    say("\n\n".join(["", *words, f"Written to {path}."]))


def line(trials: Sequence["Trial"], budget: int, left: float) -> str:
    """Say what the last trial was and reached, which one is the best, and how long the others will take."""
    from aircl_jax.tuning.ranges import shown

    last, best = trials[-1], max(trials, key=lambda trial: trial.score)
    reached = "  ".join(f"{name} {value:.3f}" for name, value in last.measures.items()) or f"failed: {last.failure}"
    tried = "  ".join(f"{name}={shown(value)}" for name, value in last.values.items())
    minutes, seconds = divmod(round(left), 60)
    ahead = f"best {best.score:.3f} (trial {trials.index(best) + 1})" if best.measures else "none has a score yet"
    return f"trial {len(trials)}/{budget}  {reached}  {tried}  {ahead}  {minutes}:{seconds:02d} left"


def command_of(composed: Composed, best: "Trial", settings: SearchSettings) -> str:
    """Write the command that trains with the settings of a trial, on seeds that the search has not seen."""
    from aircl_jax.tuning.ranges import label

    kept = [word for word in composed.words if word.partition("=")[0].partition(".")[0] not in _OF_A_SEARCH]
    kept += [f"first_seed={settings.first_seed + settings.seeds}", f"run_dir={settings.run_dir}_best"]
    found = [f"{name}={label(value).replace(' ', '')}" for name, value in best.values.items()]
    return shlex.join(["python", "-m", "experiments.run", *kept, *found])


def ranges_among(words: Sequence[str]) -> tuple[dict[str, Sequence[Any]], list[str]]:
    """Take the words that give a range or a list out of all words. Raises ValueError for one that cannot be read."""
    ranges, others = dict[str, Sequence[Any]](), list[str]()
    for word in words:
        name, _, text = word.partition("=")
        parts = re.split(r",(?![^\[]*\])", text)
        if SEARCHED.match(word) and len(parts) > 1:
            ranges[name] = [value_of(word, part) for part in parts]
        elif SEARCHED.match(word) and ":" in text and text[:1] not in tuple("[{"):
            ranges[name] = tuple(value_of(word, part) for part in text.split(":"))
        else:
            others.append(word)
    return ranges, others


_DEFAULTS = ["_self_", {"env": DEFAULT_ENV}, {"method": "default"}, {"train": "${env}_${method}"}, *QUIET]

if __name__ == "__main__":
    sys.exit(main())
