"""The protocol that every world follows: one episode of one environment, pure functions, no batch axis."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, Shaped


class Step(NamedTuple):
    """What one control step returns: the next observation, the true reward and cost of this step (NaN: unknown), its end."""

    obs: Float[Array, " O"]
    reward: Float[Array, ""]
    cost: Float[Array, ""]
    terminated: Float[Array, ""]


@dataclass(frozen=True)
class Discrete:
    """Actions 0 … n − 1, as integers of shape []."""

    n: int

    @property
    def feature_size(self) -> int:
        return self.n

    @property
    def shape(self) -> tuple[int, ...]:
        return ()

    def features(self, action: Int[Array, ""]) -> Float[Array, " A"]:
        """The action as the networks see it: one-hot."""
        return jax.nn.one_hot(action, self.n)


@dataclass(frozen=True)
class Box:
    """Actions in [low, high]^size, as floats of shape [size]; the environment clips, the trajectory keeps the draw."""

    size: int
    low: float = -1.0
    high: float = 1.0

    @property
    def feature_size(self) -> int:
        return self.size

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.size,)

    def clip(self, action: Float[Array, " A"]) -> Float[Array, " A"]:
        return jnp.clip(action, self.low, self.high)

    def features(self, action: Float[Array, " A"]) -> Float[Array, " A"]:
        """The action as the networks see it: clipped as the environment clips it, so that clipping gives nothing away."""
        return self.clip(action)


class Tabular(NamedTuple):
    """A finite world in full: what exact planning needs. X are its states (Markov, so perhaps more than the cells seen)."""

    transition: Float[Array, "X A X"]  # P(x'|x, a)
    reward: Float[Array, "X A"]  # E[r | x, a], NaN where unknown
    cost: Float[Array, " X"]  # cost of a step taken in x, NaN where unknown
    forbidden: Float[Array, " X"]  # 1 where an expert may not enter
    start: Float[Array, " X"]  # distribution of x_0
    obs: Float[Array, "X O"]  # what is seen in x
    goal: Float[Array, " X"]  # 1 where the episode has succeeded (all 0 in a world without a goal)


class Layout(NamedTuple):
    """A square grid as it is drawn; cells are [row, column], and observation i is one-hot of [i // size, i % size]."""

    size: int
    start: tuple[int, int]
    goal: tuple[int, int]
    zones: dict[str, tuple[tuple[int, int], ...]]  # the cells that the constraint speaks of, by name


class Codes(NamedTuple):
    """A world of codes: observation i is one-hot of code i, and action j makes j the next code."""

    names: tuple[str, ...]
    impossible: Bool[np.ndarray, "C C"]  # [from, to] that recording and coding rule out, whatever the animals want


class Maze(NamedTuple):
    """A world of nodes: observation i is one-hot of node i; where to draw the nodes, and which ones have a name."""

    position: Float[np.ndarray, "X 2"]
    successor: Int[np.ndarray, "X A"]
    marks: dict[str, int]


class Recorded(NamedTuple):
    """Demonstrations that come with a world's data: obs [N, T, O], action, mask, reward and cost (NaN: unknown), by name."""

    demonstrations: Callable[[], dict[str, Any]]
    reference: Callable[[], dict[str, Any]] | None  # None: nothing is known by which to score a feasibility


def _identity(obs: Float[Array, " O"]) -> Float[Array, " R"]:
    return obs


@dataclass(frozen=True, eq=False)
class Env:
    """One world. `reset(key) -> (state, obs)`; `step(key, state, action) -> (state, Step)`; both pure, for one episode."""

    name: str
    horizon: int
    obs_size: int
    action_space: Discrete | Box
    reset: Callable[[PRNGKeyArray], tuple[Any, Float[Array, " O"]]]
    step: Callable[[PRNGKeyArray, Any, Shaped[Array, "*A"]], tuple[Any, Step]]
    finite_horizon: bool = False  # the task ends at the horizon: the policy sees t/T and nothing is worth anything after it
    reward_view: Callable[[Float[Array, " O"]], Float[Array, " R"]] = _identity  # the smooth coordinates that f may see
    reward_view_size: int = 0  # R; 0 stands for obs_size
    constraint_input: Literal["state", "action", "state_action"] = "state"  # what a constraint of this kind of task speaks of
    simulated: bool = False  # stands in for recordings of animals
    has_reward: bool = True  # False for animals: there is no true reward to read, and `step` gives NaN
    tabular: Tabular | None = None  # the world as tables, where it is finite
    expert_temperature: float = 1.0  # of the exact soft-optimal expert, where the world is finite
    success_return: float | None = None  # an episode has reached the goal iff its true return reaches this; None: no goal
    recorded: Recorded | None = None  # demonstrations of the world's own data, where it has some
    demonstrations: str | None = None  # name of the shipped D_E (and of its reference set), where experts are trained
    layout: Layout | None = None  # how to draw a world whose observations are the cells of a grid
    codes: Codes | None = None  # what the codes of a world of codes are called
    maze: Maze | None = None  # how to draw a world whose observations are the nodes of a maze
    coordinates: tuple[str, ...] = ()  # what figures call those of an observation; by number where there are none
    motors: tuple[str, ...] = ()  # what figures call the components of a Box's action; likewise

    @property
    def title(self) -> str:
        """What reports and figures call the world."""
        return f"{self.name} (simulated)" if self.simulated else self.name

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        return self.coordinates or tuple(f"coordinate {index}" for index in range(self.obs_size))

    @property
    def motor_names(self) -> tuple[str, ...]:
        return self.motors or tuple(f"action {index}" for index in range(self.action_space.feature_size))

    @property
    def enumerated(self) -> bool:
        """Whether observations are one-hot of few codes or nodes, so that a function of a step is a small table."""
        return (self.codes is not None or self.maze is not None) and not self.finite_horizon
