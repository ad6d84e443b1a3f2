"""Put any controller behind a learned constraint: an action that it forbids is replaced by the nearest that it allows."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, PRNGKeyArray, Shaped

from aircl_jax.model.feasibility import FORBIDDEN_BELOW
from aircl_jax.runs.result import Result
from aircl_jax.transfer.judges import Judge, Kind, judge_of
from aircl_jax.transfer.projections import closer, first_of, nearest_of
from envs import Box, Discrete

DRAWS = 64  # candidates for a replacement, where nothing better than drawing some is known
WIDTHS = (0.05, 0.15, 0.5)  # of their noise around what was wanted, in half-widths of the box

Controller = Callable[[Any, Any], Any]  # (obs, key) -> action


class Decision(NamedTuple):
    """What was done at one step."""

    action: Shaped[Array, "*A"]
    replaced: Bool[Array, ""]
    feasible: Bool[Array, ""]  # of the action taken; False where none was found that passes


@dataclass(eq=False)
class Shielded:
    """A controller behind a shield, itself one: `(obs, key) -> action`. Called outside of `jit`, it counts what it does."""

    controller: Controller
    judge: Judge
    space: Box | Discrete
    steps: int = field(default=0, init=False)
    replaced: int = field(default=0, init=False)
    helpless: int = field(default=0, init=False)  # steps at which no action was found that passes

    def __post_init__(self) -> None:
        self._passes, self._correct = jax.jit(self._is_feasible), jax.jit(self._corrected)

    def __call__(self, obs: Any, key: Any) -> Any:
        """Return the controller's action, or its replacement."""
        if isinstance(obs, Tracer) or isinstance(key, Tracer):
            return self.decide(obs, key).action
        wanted = self.controller(obs, key)
        self.steps += 1
        if self._passes(obs, wanted):
            return wanted
        draws = None
        if isinstance(self.space, Discrete):
            draws = jnp.stack([jnp.asarray(self.controller(obs, one)) for one in _keys(key)])
        decision = self._correct(obs, wanted, key, draws)
        self.replaced += 1
        self.helpless += not decision.feasible
        return decision.action

    def __str__(self) -> str:
        share = self.replaced / max(self.steps, 1)
        return (
            f"{self.replaced} of {self.steps} actions replaced ({share:.1%}), {self.helpless} of them by none that passes; "
            f"judged by {self.judge.words}"
        )

    def decide(self, obs: Float[Array, " O"], key: PRNGKeyArray) -> Decision:
        """Return the action and what was done to it; pure, for `scan` and `vmap`, where the controller is."""
        wanted = jnp.asarray(self.controller(obs, key))
        draws = None
        if isinstance(self.space, Discrete):
            draws = jax.vmap(lambda one: jnp.asarray(self.controller(obs, one)))(_keys(key))
        return self._corrected(obs, wanted, key, draws)

    def _is_feasible(self, obs: Array, action: Array) -> Bool[Array, ""]:
        return self.judge.feasible(obs, self._within(action))

    def _within(self, action: Array) -> Array:
        """The action as the world will take it."""
        return self.space.clip(action) if isinstance(self.space, Box) else action

    def _corrected(self, obs: Array, wanted: Array, key: Array, draws: Array | None) -> Decision:
        passes = self._is_feasible(obs, wanted)
        other = self._other(obs, self._within(wanted), key, draws).astype(wanted.dtype)
        action = jnp.where(passes, wanted, other)
        return Decision(action, ~passes, self._is_feasible(obs, action))

    def _other(self, obs: Array, wanted: Array, key: Array, draws: Array | None) -> Array:
        """The replacement; `draws` are further draws of the controller, where actions are numbered."""
        if self.judge.nearest is not None:
            return self.judge.nearest(obs, wanted)
        if isinstance(self.space, Box):
            draws = _around(wanted, self.space, key)
            delta = jax.vmap(self.judge.delta, (None, 0))(obs, draws)
            found = nearest_of(wanted, draws, delta >= FORBIDDEN_BELOW, delta)
            return closer(wanted, found, lambda action: self.judge.feasible(obs, action))
        every = jax.vmap(self.judge.delta, (None, 0))(obs, jnp.arange(self.space.n))
        return jnp.argmax(every) if draws is None else first_of(draws, every[draws] >= FORBIDDEN_BELOW, jnp.argmax(every))


def shield(result: Result, index: int = 0, *, by: Kind = "default") -> Callable[[Controller], Shielded]:
    """Make the shield of a finished run, by what the seed at this place of `summary["seeds"]` learned of single steps.

    It wraps any controller `(obs, key) -> action`. An action of which δ₁ is below ½ is replaced by the nearest that passes:

    - `limits`: the nearest within the limits that δ₁ draws of each motor (`analysis.recovered_limits`), whatever the state;
    - `sum`: the nearest that passes a δ₁ that is a sum over coordinates, in the state as it is;
    - `draws`: of a Box the nearest of actions drawn around the wanted one. Of numbered actions the first that passes of
      further draws of the controller, whose law is the controller's own on what is feasible.

    The default is the first of these that the run allows. δ̄ of whole trajectories is not asked.

    Raises:
        ValueError: in one line, where the run has nothing to judge an action by.
    """
    judge, space = judge_of(result, index, by), result.spec.env.action_space
    return lambda controller: Shielded(controller, judge, space)


def _keys(key: PRNGKeyArray) -> Array:
    """The keys of further draws; the first draw has `key` itself."""
    return jax.random.split(jax.random.fold_in(key, 1), DRAWS)


def _around(wanted: Float[Array, " A"], space: Box, key: PRNGKeyArray) -> Float[Array, "M A"]:
    """Draw actions around the wanted one, closer and further, and all over the box."""
    key_near, key_far = jax.random.split(jax.random.fold_in(key, 1))
    each = DRAWS // (len(WIDTHS) + 1)
    noise = jax.random.normal(key_near, (len(WIDTHS), each, space.size)) * jnp.asarray(WIDTHS)[:, None, None]
    far = jax.random.uniform(key_far, (each, space.size), minval=-1.0, maxval=1.0)
    near = (space.in_half_widths(wanted) + noise).reshape(-1, space.size)
    return jax.vmap(space.clip)(space.from_half_widths(jnp.concatenate([near, far])))
