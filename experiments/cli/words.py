"""key=value words of the commands that need no Hydra: types and choices come from a dataclass of settings."""

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import yaml

from envs.settings import at_least, updated

T = TypeVar("T")
SEEDS = 10  # of every result of this project


def parse(words: Sequence[str], default: T, about: str | None) -> T:
    """The settings with these words in place of their own; `--help` prints `about` and ends.

    Raises ValueError, in one line, for what does not fit.
    """
    if "--help" in words:
        print(about)
        raise SystemExit(0)
    overrides: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"cannot read {word!r}; write NAME=VALUE")
        overrides[name] = yaml.safe_load(value)
    return updated(default, overrides)


def listed(name: str, given: str, known: Sequence[str]) -> tuple[str, ...]:
    """A comma list of names, or all of them. Raises ValueError for an unknown one."""
    chosen = known if given == "all" else [word.strip() for word in given.split(",")]
    for word in chosen:
        if word not in known:
            raise ValueError(f"unknown {name} {word!r}; choose from {', '.join(known)}, or all")
    return tuple(word for word in known if word in chosen)


def smoke_budget() -> dict[str, Any]:
    """Read the seeds, iterations and training settings (`train`) of scale=smoke from the one file that states them."""
    file = resources.files("experiments.cli.conf") / "scale" / "smoke.yaml"
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def refuse_short_runs(seeds: int, iterations: int, out: str, results: str) -> None:
    """Raises ValueError for numbers that cannot be, and for fewer or shorter runs where results are kept."""
    at_least("seeds", seeds, 1)
    at_least("iterations", iterations, 0)
    if (seeds != SEEDS or iterations) and Path(out).resolve() == Path(results).resolve():
        raise ValueError(f"seeds={seeds} iterations={iterations}: {results} has {SEEDS} seeds; choose out=DIR")
