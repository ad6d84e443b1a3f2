"""Collect and check everything that determines a run's numbers, before anything is computed or written."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aircl_jax.algorithm.terms.table import check_method
from aircl_jax.demonstrations import files
from aircl_jax.demonstrations.sources import REFERENCE_SEED
from aircl_jax.methods import METHODS, Method, get_method
from aircl_jax.settings.checks import check_config
from aircl_jax.settings.env_defaults import CORRECTED, config_of, default_method
from aircl_jax.settings.renamed import refuse_old_names, renamed
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Trajectory
from envs import ENVS, Activities, Box, Env
from envs.checks import check_env
from envs.registry import build, options_of
from envs.settings import at_least, plain, updated


@dataclass(frozen=True)
class RunSpec:
    """A checked run.

    `own` holds the user's demonstrations, and None where the environment's own are used. `reference` holds the reference
    set beside their file, and None where there is none. `named` is False for an environment without a name, whose runs
    cannot be loaded.
    """

    env: Env
    named: bool
    env_settings: Mapping[str, Any]
    method_name: str
    method: Method
    contrast_prior: str
    seeds: tuple[int, ...]
    config: TrainConfig
    source: str
    own: Trajectory | None
    reference: Trajectory | None
    digest: str  # SHA-256 of recorded or own demonstrations and of the reference set beside the latter; else empty
    tasks: tuple[str, ...] = ()  # names of the tasks that learn one constraint together; empty where the run is alone
    task: int = 0  # the number of this one

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings as config.yaml holds them and a resumed run must repeat them."""
        config = plain(asdict(self.config))
        return {
            "env": {"name": self.env.name, **plain(self.env_settings)} if self.named else {"name": self.env.name, "own": True},
            "method": self.method_name,
            "contrast_prior": self.contrast_prior,
            "seeds": len(self.seeds),
            "first_seed": self.seeds[0],
            "iterations": config.pop("iterations"),
            "demonstrations": {"source": self.source, "sha256": self.digest} if self.digest else self.source,
            "train": config,
            **({"tasks": {"all": list(self.tasks), "this": self.tasks[self.task]}} if self.tasks else {}),
        }

    @property
    def env_steps(self) -> int:
        """Count the environment steps of one iteration over all seeds, in the trajectories that enter an update."""
        if self.method.is_fitted:
            return 0
        pool = self.config.pool_factor if self.method.has_pool else 1
        return len(self.seeds) * self.config.num_trajectories * pool * self.env.horizon


def make_spec(
    env: str | Env,
    method: str,
    *,
    contrast_prior: Literal["method", "on", "off"],
    seeds: int,
    first_seed: int,
    iterations: int | Literal["default"],
    demonstrations: str | Path,
    env_settings: Mapping[str, Any],
    config: TrainConfig | Mapping[str, Any],
    tasks: tuple[str, ...] = (),
    task: int = 0,
) -> RunSpec:
    """Resolve names, defaults and files. Raises ValueError, in one line, for settings that do not fit."""
    if isinstance(env, Env) and env_settings:
        raise ValueError(
            f"env_settings are given beside the Env {env.name}, which has its own; choose make_env(name, **settings)"
        )
    world, options = (env, env_settings) if isinstance(env, Env) else _named_env(env, env_settings, method)
    check_env(world)
    if method == "default":
        method = default_method(world.name) if world.registered else CORRECTED
    row = get_method(method, contrast_prior, of_box=isinstance(world.action_space, Box))
    check_method(method, row)
    if not isinstance(config, TrainConfig):
        refuse_old_names(config, "train")
        config = updated(config_of(world, row.settings), config, "train")
    if iterations != "default":
        config = replace(config, iterations=at_least("iterations", iterations, 1))
    check_config(config, "train")
    if row.learns_feasibility and (config.constraint_input, world.constraint_input) == ("action", "state"):
        raise ValueError(
            f"train.constraint_input=action: the constraint of env={world.name} reads states alone; choose env, or state_action"
        )
    count, first = at_least("seeds", seeds, 1), at_least("first_seed", first_seed, 0)
    if first + count > REFERENCE_SEED:
        raise ValueError(f"first_seed={first}, seeds={count}: a seed is too great; choose seeds below {REFERENCE_SEED}")
    if row.is_fitted:
        _check_recorded(method, world, demonstrations)
    own, reference = _own_demonstrations(demonstrations, world)
    unknown = not world.has_reward if own is None else np.isnan(own.reward).any()
    if row.needs_true_reward and "contrast" in row.terms and unknown:
        whose = f"env={world.name}" if own is None else f"demonstrations={demonstrations}"
        raise ValueError(f"{whose}: reward is missing, which the contrast prior of {method} compares")
    return RunSpec(
        env=world,
        named=not isinstance(env, Env),
        env_settings=options,
        method_name=method,
        method=row,
        contrast_prior=contrast_prior,
        seeds=tuple(range(first, first + count)),
        config=config,
        source=str(demonstrations),
        own=own,
        reference=reference,
        digest=_digest(*_read_for(world, own, reference)),
        tasks=tasks,
        task=task,
    )


def read_spec(settings: Mapping[str, Any]) -> RunSpec:
    """Read the spec from its `settings`, under their present or their earlier names.

    Raises ValueError where an environment or a file no longer exists.
    """
    try:
        settings = renamed(settings)
        env, demonstrations = dict(settings["env"]), settings["demonstrations"]
        name, method, config = str(env.pop("name")), str(settings["method"]), dict(settings["train"])
        source = demonstrations if demonstrations == "default" else str(demonstrations["source"])
        rest = {name: settings[name] for name in ("contrast_prior", "seeds", "first_seed", "iterations")}
        if together := settings.get("tasks"):
            rest |= {"tasks": tuple(together["all"]), "task": together["all"].index(together["this"])}
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(
            f"the settings of the run are damaged: {error} is missing or wrong; restore its config.yaml"
        ) from error
    if "own" in env:
        raise ValueError(f"env={name} was given as an Env, which a run does not keep; choose a run on a named environment")
    spec = make_spec(name, method, demonstrations=source, env_settings=env, config=config, **rest)
    if spec.settings["demonstrations"] != demonstrations:
        raise ValueError(f"demonstrations={spec.source} is not what the run had: the content has changed")
    return spec


def _named_env(name: str, settings: Mapping[str, Any], method: str) -> tuple[Env, dict[str, Any]]:
    """Build an environment of the table; a method that is fitted to whole recordings has env.state=full by default."""
    fitted = method in METHODS and METHODS[method].is_fitted
    if fitted and settings.get("state", "default") == "default" and name in ENVS and hasattr(ENVS[name].options, "state"):
        settings = {**settings, "state": "full"}
    options = options_of(name, settings)
    return build(name, options), asdict(options)


def _check_recorded(method: str, world: Env, demonstrations: str | Path) -> None:
    """Raise ValueError where a row that is fitted to whole recordings is given anything else."""
    if not isinstance(world.view, Activities):
        choice = "env=meerkat env.state=full, with a mapping for other animals"
        raise ValueError(f"env={world.name}: method={method} is fitted to whole recordings of animals; choose {choice}")
    if demonstrations != "default":
        raise ValueError(f"demonstrations={demonstrations}: method={method} reads whole recordings; choose env.data=FOLDER")


def _own_demonstrations(demonstrations: str | Path, env: Env) -> tuple[Trajectory | None, Trajectory | None]:
    """Read the user's own D_E, and NAME_reference.npz beside it where the environment has no reference set itself."""
    if demonstrations == "default":
        return None, None
    own, path = files.load(demonstrations, env), Path(demonstrations)
    beside = path.parent / f"{path.stem}_reference.npz"
    scored = env.expert is None and beside.is_file()
    return own, files.load(beside, env) if scored else None


def _read_for(env: Env, own: Trajectory | None, reference: Trajectory | None) -> list[Trajectory]:
    """List the trajectories read from the user's files, whose content a resumed run must find again."""
    if own is not None:
        return [own] if reference is None else [own, reference]
    return [] if env.recorded is None else [files.from_arrays(env.recorded.demonstrations(), env)]


def _digest(*sets: Trajectory) -> str:
    digest = hashlib.sha256()
    for trajectories in sets:
        for leaf in trajectories:
            digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest() if sets else ""
