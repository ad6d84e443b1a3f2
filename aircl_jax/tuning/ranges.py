"""Read what a search may vary: a setting of training between two ends, or one of a list."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from aircl_jax.settings.checks import check_config
from aircl_jax.settings.train_config import TrainConfig
from envs.settings import flatten, plain, updated

GROUP = "train"
# Settings that a search has of its own.
_OWN = {"train.iterations": "give iterations=N", "train.num_demonstrations": "give held_out=SHARE"}


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, drawn evenly or evenly in their logarithm; whole ones where the setting is one."""

    low: int | float
    high: int | float
    log: bool
    whole: bool

    def holds(self, value: Any) -> bool:
        return isinstance(value, (int, float)) and self.low <= value <= self.high

    @property
    def ends(self) -> tuple[Any, ...]:
        return self.low, self.high


@dataclass(frozen=True)
class Choice:
    """One of some values of any kind."""

    options: tuple[Any, ...]

    def holds(self, value: Any) -> bool:
        return label(value) in map(label, self.options)

    @property
    def ends(self) -> tuple[Any, ...]:
        return self.options


Ranges = Mapping[str, Range | Choice]


def read_ranges(given: Mapping[str, Sequence[Any]], config: TrainConfig) -> dict[str, Range | Choice]:
    """Read {"train.NAME": (low, high) or (low, high, "log") or [one, other, …]}, and try the ends of each.

    Raises ValueError, in one line, for whatever is no setting of training, or no value of it.
    """
    if not given:
        raise ValueError("there is nothing to search; give a range, as in train.ppo.learning_rate=0.0001:0.01:log")
    now, ranges = flatten(asdict(config), GROUP), dict[str, Range | Choice]()
    for name, values in given.items():
        if not name.startswith(f"{GROUP}."):
            raise ValueError(f"{name} cannot be searched; choose settings of training, train.NAME")
        if name in _OWN:
            raise ValueError(f"{name} cannot be searched; {_OWN[name]}")
        ranges[name] = _choice(name, values) if isinstance(values, list) else _range(name, values, now.get(name))
        for end in ranges[name].ends:
            check_config(updated(config, nested({name: end}), GROUP), GROUP)
    return ranges


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Turn {"train.ppo.learning_rate": x} into {"ppo": {"learning_rate": x}}, as `train(config=…)` takes it."""
    groups: dict[str, Any] = {}
    for name, value in values.items():
        *path, last = name.split(".")[1:]
        group = groups
        for step in path:
            group = group.setdefault(step, {})
        group[last] = value
    return groups


def label(value: Any) -> str:
    """Write a value as one types it: a text as it is, anything else as JSON."""
    return value if isinstance(value, str) else json.dumps(plain(value))


def shown(value: Any) -> str:
    """Write a value shortly, for a table."""
    return f"{value:.4g}" if isinstance(value, float) else label(value)


def _choice(name: str, values: list[Any]) -> Choice:
    if len(values) < 2:
        raise ValueError(f"{name}: a list of {len(values)} leaves no choice; give at least two values")
    return Choice(tuple(values))


def _range(name: str, values: Sequence[Any], now: Any) -> Range:
    ends, rest = values[:2], list(values[2:])
    numbers = all(isinstance(end, (int, float)) and not isinstance(end, bool) for end in ends)
    if len(ends) < 2 or not numbers or rest not in ([], ["log"]):
        raise ValueError(f"{name}={':'.join(map(str, values))} is no range; write LOW:HIGH or LOW:HIGH:log")
    low, high = ends
    if not low < high:
        raise ValueError(f"{name}={low}:{high} is empty; the first number has to be the smaller")
    if rest and low <= 0:
        raise ValueError(f"{name}={low}:{high}:log begins at {low}; a logarithm needs numbers above 0")
    return Range(low, high, bool(rest), whole=type(now) is int)
