"""Sweep over one coefficient: every value and every seed in one program that is compiled once."""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.algorithm.evaluation import evaluate
from aircl_jax.algorithm.trainer import Trainer, make_trainer
from aircl_jax.demonstrations import sources
from aircl_jax.model.networks import make_networks
from aircl_jax.runs.seeds import make_evaluator, make_runner
from aircl_jax.runs.spec import RunSpec
from aircl_jax.settings.checks import check_config
from aircl_jax.settings.train_config import Coefficients, Scalar, TrainConfig
from aircl_jax.types import Metrics, TrainState, Trajectory


def sweep(spec: RunSpec, coefficient: str, values: Sequence[float]) -> dict[str, Float[np.ndarray, "V S"]]:
    """Train a run at each value of a coefficient; return every metric of the final evaluation by value and seed.

    Seed s starts from the same state and sees the same demonstrations at every value, so that values are paired by seed.

    Raises:
        ValueError: in one line, for a name that is no coefficient, or for no value.
    """
    known = [field.name for field in fields(Coefficients)]
    if coefficient not in known:
        raise ValueError(f"coefficient={coefficient} is unknown; choose from {', '.join(known)}")
    if not values:
        raise ValueError("values is empty; give at least one")
    if spec.own is not None:
        raise ValueError(f"demonstrations={spec.source}: a sweep runs on the environment's own; choose default")
    for value in values:
        check_config(_with_value(spec.config, coefficient, value).coefficients, "train.coefficients")
    expert, reference = sources.demonstrations(spec.env, spec.seeds, spec.config)
    experts = jax.tree.map(lambda leaf: jnp.concatenate([leaf] * len(values)), expert)
    lanes = (experts, jnp.repeat(jnp.asarray(values, jnp.float32), len(spec.seeds)))
    runner = make_runner(_trainer(spec, coefficient), spec.seeds * len(values))
    states, left = runner.init(lanes), spec.config.iterations
    while left:
        length = min(spec.config.checkpoint_every, left)
        states, _ = runner.run_chunk(states, lanes, length)
        left -= length
    measure = make_evaluator(partial(_evaluate, spec, coefficient), len(spec.seeds) * len(values))
    metrics = jax.device_get(measure(states, lanes, reference))
    return {name: np.asarray(metric).reshape(len(values), len(spec.seeds)) for name, metric in metrics.items()}


def _with_value(config: TrainConfig, coefficient: str, value: Scalar) -> TrainConfig:
    changed: Any = {coefficient: value}
    return replace(config, coefficients=replace(config.coefficients, **changed))


def _trainer(spec: RunSpec, coefficient: str) -> Trainer:
    """Make a trainer whose second argument is D_E and the coefficient's value."""

    def of(value: Float[Array, ""]) -> Trainer:
        return make_trainer(spec.env, spec.method, _with_value(spec.config, coefficient, value))

    def init(key: PRNGKeyArray, lane: Any) -> TrainState:
        return of(lane[1]).init(key, lane[0])

    def step(state: TrainState, lane: Any) -> tuple[TrainState, Metrics]:
        return of(lane[1]).step(state, lane[0])

    return Trainer(init, step, make_networks(spec.env, spec.method, spec.config))


def _evaluate(spec: RunSpec, coefficient: str, state: TrainState, lane: Any, reference: Trajectory) -> Metrics:
    nets = make_networks(spec.env, spec.method, _with_value(spec.config, coefficient, lane[1]))
    return evaluate(nets, state, lane[0], reference)
