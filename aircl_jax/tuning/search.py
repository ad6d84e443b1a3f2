"""Search settings of training by demonstrations that are held out: no true reward and no true cost is asked."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np

from aircl_jax.api import train
from aircl_jax.demonstrations import files, sources
from aircl_jax.reports import markdown
from aircl_jax.runs.opening import existing
from aircl_jax.runs.spec import RunSpec, make_spec
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.storage import disk, locked
from aircl_jax.tuning.held_out import Weights, measure, split
from aircl_jax.tuning.ranges import GROUP, nested, read_ranges, shown
from aircl_jax.tuning.study import SCORE, STUDY, OnTrial, Trial, defaults_within, explore, imported
from aircl_jax.types import Trajectory
from envs import Env
from envs.settings import at_least, flatten, updated

TRAINING, HELD_OUT, TABLE = "training.npz", "held_out.npz", "search.md"
THEN = "once it can be, the same command with resume=true goes on"


@dataclass(frozen=True)
class Found:
    """The trials of a search, and the settings of the best one; `config` is what `train(config=…)` takes."""

    trials: list[Trial]
    best: Trial
    config: TrainConfig
    has_defaults: bool  # the first trial is the defaults

    @property
    def table(self) -> str:
        """Tabulate the trials, the best one first, those without a score last."""
        names, measures = list(self.best.values), list(self.best.measures)
        order = sorted(range(len(self.trials)), key=lambda place: -self.trials[place].score)
        rows = [(_named(place, self.has_defaults), *_cells(self.trials[place], names, measures)) for place in order]
        return markdown.table(("trial", *measures, *names), rows, aligned=True)


def search(
    env: str | Env = "gridworld",
    method: str = "default",
    *,
    ranges: Mapping[str, Sequence[Any]],
    run_dir: str | Path,
    budget: int = 20,
    held_out: float = 0.2,
    weights: Mapping[str, float] | None = None,
    seeds: int = 1,
    first_seed: int = 0,
    iterations: int | Literal["default"] = "default",
    demonstrations: str | Path = "default",
    contrast_prior: Literal["method", "on", "off"] = "method",
    env_settings: Mapping[str, Any] | None = None,
    config: TrainConfig | Mapping[str, Any] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    on_trial: OnTrial = lambda trials, left: None,
) -> Found:
    """Train with `budget` settings out of `ranges` on a part of the demonstrations, and score each on the part held out.

    `ranges` has {"train.NAME": (low, high), (low, high, "log") or [one, other, …]}; `weights` are those of `Weights`. All else
    is as in `train`. The study is kept in `run_dir`, with both parts of the demonstrations, and `resume` continues it.

    Raises:
        ValueError: in one line, for whatever does not fit, or where no trial has a score.
        DiskError: in one line, where the disk is full, read-only or gone; the trials so far stay.
    """
    imported()
    spec = make_spec(
        env,
        method,
        contrast_prior=contrast_prior,
        seeds=seeds,
        first_seed=first_seed,
        iterations=iterations,
        demonstrations=demonstrations,
        env_settings=env_settings or {},
        config=config or {},
    )
    if spec.method.is_fitted:
        raise ValueError(f"method={spec.method_name} is fitted at once and has nothing to search; choose a row that is trained")
    at_least("budget", budget, 1)
    weighing, space = updated(Weights(), weights or {}, "weights"), read_ranges(ranges, spec.config)
    parts = split(_demonstrations(spec), held_out)
    defaults = {name: value for name, value in flatten(asdict(spec.config), GROUP).items() if name in space}
    settings = {
        **flatten(spec.settings),
        "held_out": held_out,
        "demonstrations": _digest(*parts),
        **flatten(asdict(weighing), "weights"),
        **{name: repr(of) for name, of in space.items()},
    }
    folder = Path(run_dir)
    mode = _decide(folder, existing(resume, overwrite))

    def score(values: dict[str, Any]) -> dict[str, float]:
        result = train(
            env,
            method,
            contrast_prior=contrast_prior,
            seeds=seeds,
            first_seed=first_seed,
            demonstrations=folder / TRAINING,
            env_settings=env_settings,
            config=updated(spec.config, nested(values), GROUP),
        )
        found = measure(result, parts[1])
        return {SCORE: weighing.score(found), **found}

    with disk(folder, THEN):
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder) as ours:
            if not ours:
                raise ValueError(f"run_dir={folder} is in use by another search; wait for it or choose another directory")
            if mode == "afresh":
                (folder / STUDY).unlink(missing_ok=True)
                for name, part in zip((TRAINING, HELD_OUT), parts, strict=True):
                    files.save(folder / name, part, {"source": f"{spec.source}, {name.partition('.')[0]} of a search"})
            trials = explore(folder, space, defaults, score, budget, settings, on_trial)
    best = max(trials, key=lambda trial: trial.score)
    if not best.measures:
        raise ValueError(f"no trial of run_dir={folder} has a score; the last one: {trials[-1].failure}")
    return Found(trials, best, updated(spec.config, nested(best.values), GROUP), defaults_within(space, defaults))


def _demonstrations(spec: RunSpec) -> Trajectory:
    """Return D_E [N, T, …]: one's own file, or the world's, of a grid those of the first seed."""
    if spec.own is not None:
        return spec.own
    every, _ = sources.demonstrations(spec.env, spec.seeds[:1], spec.config)
    return jax.tree.map(lambda leaf: np.asarray(leaf[0]), every)


def _digest(*parts: Trajectory) -> str:
    digest = hashlib.sha256()
    for leaf in (leaf for part in parts for leaf in (part.obs, part.action, part.mask)):
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()


def _decide(folder: Path, mode: str) -> Literal["afresh", "resume"]:
    """Say how to begin in a folder. Raises ValueError where it may not be used."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"run_dir={folder} is a file; choose a directory")
    if not (folder / STUDY).exists():
        names = sorted(entry.name for entry in folder.iterdir()) if folder.exists() else []
        foreign = [name for name in names if name not in (TRAINING, HELD_OUT, TABLE)]
        if foreign:
            raise ValueError(f"run_dir={folder} holds files ({foreign[0]}, …) and no {STUDY}; choose another directory")
        return "afresh"
    if mode == "refuse":
        raise ValueError(f"run_dir={folder} already holds a search; choose resume=true, overwrite=true or another directory")
    return "resume" if mode == "resume" else "afresh"


def _named(place: int, has_defaults: bool) -> str:
    return "1, the defaults" if place == 0 and has_defaults else str(place + 1)


def _cells(trial: Trial, names: list[str], measures: list[str]) -> list[str]:
    found = [f"{trial.measures[name]:.3f}" if trial.measures else "—" for name in measures]
    return [*found, *(shown(trial.values[name]) for name in names)]
