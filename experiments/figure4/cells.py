"""Make the cells of Figure 4: a method trained on one data set, its causal links, and its recovered functions."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import jax
import numpy as np
from jaxtyping import Int

from aircl_jax import Result, train
from aircl_jax.algorithm.scoring import roll_out_and_draw
from aircl_jax.analysis.causal import (
    Links,
    difference,
    link_strengths,
    markov_chain,
    sample_chain,
    strongest,
    uniform_windows,
    yardsticks,
)
from aircl_jax.analysis.recovered import Recovered, recover
from aircl_jax.messages import say
from aircl_jax.methods import METHODS
from aircl_jax.model.networks import Networks
from aircl_jax.storage import write_whole
from aircl_jax.types import TrainState
from envs import Tabular
from envs.animals.meerkat import Herd, load
from envs.options import MeerkatOptions
from envs.settings import at_least
from experiments.cli.words import listed, smoke_budget
from experiments.shared.commits import current_commit
from experiments.shared.kept_files import read_kept

ROWS = (
    *("airl", "airl_centred", "gacl", "aircl", "aircl_no_prior", "aircl_corrected", "aircl_corrected_prior", "bc"),
    *("icrl", "icrl_prior"),
)
LAGS = (1, 5)  # τ_max of the analyses
POOL = 4  # episodes of π for each window that δ̄ draws from them
KEY_WINDOWS = 4  # folded into a state's key, so that the episodes differ from those of training and evaluation


@dataclass(frozen=True)
class Settings:
    data: str = "default"  # folder of tables, simulated, or default: the folder of the variable AIRCL_DATA
    mapping: str = "meerkat"
    methods: str = "all"  # or a comma list
    seeds: int = 10
    tau_max: Literal[1, 5] = 1  # 5: the strongest of the lags 1 to 5
    folds: int = 9  # most folds that leave out two recordings each; 0 for none
    scale: Literal["full", "smoke"] = "full"  # smoke takes seconds and says nothing about results
    out: str = "default"  # default: results/figure4, or runs/figure4_smoke

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        at_least("folds", self.folds, 0)

    @property
    def options(self) -> MeerkatOptions:
        return MeerkatOptions(data=self.data, mapping=self.mapping)

    @property
    def iterations(self) -> int | Literal["default"]:
        return "default" if self.scale == "full" else smoke_budget()["iterations"]

    @property
    def training(self) -> dict[str, Any]:
        """Return the changes to a method's own settings."""
        return {} if self.scale == "full" else smoke_budget()["train"]


class Study(NamedTuple):
    """One data set: its windows of codes as PCMCI sees them, and the folder of its cells."""

    herd: Herd
    codes: Int[np.ndarray, "N T"]
    real: dict[int, Links]  # by τ_max
    folder: Path
    commit: str

    @property
    def simulated(self) -> bool:
        return self.herd.truth is not None

    @property
    def num_codes(self) -> int:
        return len(self.herd.windows.names)


def read(settings: Settings) -> Study:
    """Read the windows and compute their own links. Raises ValueError as `envs.animals.meerkat.load` does."""
    herd = load(settings.options)
    codes = herd.windows.code[:, :-1]
    default = "results/figure4" if settings.scale == "full" else "runs/figure4_smoke"
    out = Path(default if settings.out == "default" else settings.out)
    real = {lag: link_strengths(codes, len(herd.windows.names), lag) for lag in LAGS}
    kind = "simulated" if herd.truth else "recorded" if settings.mapping == Settings.mapping else Path(settings.mapping).stem
    return Study(herd, codes, real, out / kind, current_commit())


def kept(path: Path, asked: Mapping[str, Any], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Read the cell of a file; make and write it first where the file is missing.

    Raises ValueError, in one line, where an existing cell differs from what is `asked`.
    """
    if not path.exists():
        say(f"making {path}")
        cell = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(cell) + "\n")
    cell = read_kept(path, *asked)
    for name, value in asked.items():
        if cell[name] != value:
            raise ValueError(f"{path} has {name}={cell[name]}, asked for is {value}; give out=DIR, or remove the file")
    return cell


def methods(settings: Settings, study: Study) -> tuple[str, ...]:
    """List the requested methods in the order of the table. Raises ValueError for an unknown one."""
    return listed("method", settings.methods, [name for name in ROWS if study.simulated or not _needs_known_reward(name)])


def _needs_known_reward(name: str) -> bool:
    """Return whether training the row needs the true reward, which is known for simulated meerkats alone."""
    return METHODS[name].needs_true_reward and not METHODS[name].assumes_no_reward


def method_cell(settings: Settings, study: Study, method: str) -> dict[str, Any]:
    """Train a method on all windows and return its cell.

    The cell has |ΔV| of q and of π by seed, mean maps, the learned functions and learning curves.
    """
    result = train(
        "meerkat",
        method,
        seeds=settings.seeds,
        iterations=settings.iterations,
        env_settings={"data": settings.data, "mapping": settings.mapping},
        config=settings.training,
    )
    windows = generate(result, len(study.codes))
    compared = {name: _compared(study, codes) for name, codes in windows.items()}
    table = cast(Tabular, result.spec.env.tabular)
    return {
        **result.summary,
        "command": _command(settings, study, method),
        "commit": study.commit,
        "alarms": result.alarms,
        "windows": len(study.codes),
        "difference": {name: {lag: by_lag[lag]["per_seed"] for lag in map(str, LAGS)} for name, by_lag in compared.items()},
        "links": {lag: compared["sampled"][lag]["links"] for lag in map(str, LAGS)},
        "difference_map": {lag: compared["sampled"][lag]["map"] for lag in map(str, LAGS)},
        "recovered": as_json(recover(result, table)),
        "curves": {name: _rounded(result.history[name].mean(axis=1)) for name in CURVES if name in result.history},
    }


CURVES = ("entropy", "return", "feasibility_expert", "feasibility_policy", "loss_discriminator", "policy_loss")


def generate(result: Result, number: int) -> dict[str, Int[np.ndarray, "S N T"]]:
    """Generate `number` windows of codes of each seed: episodes of π, and draws of q by δ̄ from a pool of them."""
    one_seed = jax.jit(partial(_windows, result.networks, number))
    seeds = [one_seed(result.state(index)) for index in range(len(result.summary["seeds"]))]
    policy, sampled = (np.stack(parts) for parts in zip(*seeds, strict=True))
    return {"sampled": sampled, "policy": policy}


def _windows(nets: Networks, number: int, state: TrainState) -> tuple[Any, Any]:
    key_policy, key_sampler = jax.random.split(jax.random.fold_in(jax.random.fold_in(state.key, KEY_WINDOWS), state.step))
    bound = nets.bind(state.params, state.obs_stats)
    drawn = roll_out_and_draw(bound, key_policy, key_sampler, POOL * number, number)
    policy = drawn.policy.obs[:number].argmax(axis=-1)
    return policy, drawn.sampled.obs.argmax(axis=-1) if nets.method.draws else policy


def _compared(study: Study, windows: Int[np.ndarray, "S N T"]) -> dict[str, dict[str, Any]]:
    """Compute, for each τ_max, mean |ΔV| by seed, and mean V and mean |ΔV| by pair of codes."""
    compared = {}
    for lag in LAGS:
        links = np.stack([strongest(link_strengths(codes, study.num_codes, lag)) for codes in windows])
        apart = np.abs(links - strongest(study.real[lag]))
        per_seed = _rounded(apart.mean(axis=(1, 2)))
        compared[str(lag)] = {"per_seed": per_seed, "links": _rounded(links.mean(0)), "map": _rounded(apart.mean(0))}
    return compared


def yardstick_cell(settings: Settings, study: Study) -> dict[str, Any]:
    """Compute the yardsticks of mean |ΔV| by seed, and the maps of the Markov chain and of uniform windows."""
    size, length = study.codes.shape
    chain = sample_chain(*markov_chain(study.herd.windows.code, study.num_codes), size, length, seed=0)
    uniform = uniform_windows(size, length, study.num_codes, seed=0)
    cell: dict[str, Any] = {"commit": study.commit, "windows": size}
    for lag in LAGS:
        rows = [yardsticks(study.codes, study.num_codes, lag, seed) for seed in range(settings.seeds)]
        maps = {"Markov chain": chain, "uniform random": uniform}
        apart = {name: difference(link_strengths(codes, study.num_codes, lag), study.real[lag]) for name, codes in maps.items()}
        cell[str(lag)] = {
            "per_seed": {name: _rounded([row[name] for row in rows]) for name in rows[0]},
            "maps": {name: _rounded(values) for name, values in apart.items()},
        }
    return cell


def _command(settings: Settings, study: Study, method: str) -> str:
    """Return the command of a run that trains the same."""
    data = "env.data=simulated" if study.simulated else "env.data=DIR"
    return f"python -m experiments.run env=meerkat {data} method={method} seeds={settings.seeds}"


def as_json(recovered: Recovered) -> dict[str, Any]:
    return {name: _rounded(values) for name, values in recovered._asdict().items()}


def from_json(values: dict[str, Any]) -> Recovered:
    return Recovered(**{name: np.array(value, float) for name, value in values.items()})._replace(
        seen=np.array(values["seen"], np.int64)
    )


def _rounded(values: Any) -> Any:
    """Round to four significant digits, with None for NaN."""
    array = np.asarray(values)
    if array.ndim:
        return [_rounded(item) for item in array]
    return (float(f"{array:.4g}") if array.dtype.kind == "f" else int(array)) if np.isfinite(array) else None
