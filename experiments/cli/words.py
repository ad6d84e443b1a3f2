"""Read the NAME=VALUE words of commands without Hydra; a dataclass of settings gives their types and choices."""

import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import yaml

from envs.settings import at_least, updated

T = TypeVar("T")
_WHOLE = re.compile(r"[+-]?\d+", re.ASCII)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
SEEDS = 10  # number of seeds of every result of this project


def parse(words: Sequence[str], default: T, about: str | None) -> T:
    """Return the settings with these words in place of their defaults; `--help` prints `about` and exits.

    Raises ValueError, in one line, for a word that does not fit.
    """
    if "--help" in words:
        print(about)
        raise SystemExit(0)
    overrides: dict[str, Any] = {}
    texts = {name for name, kind in get_type_hints(type(default)).items() if kind is str}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            raise ValueError(f"cannot read {word!r}; write NAME=VALUE")
        overrides[name] = text if name in texts else value_of(word, text)
    return updated(default, overrides)


def value_of(word: str, text: str) -> Any:
    """Read true, false, a number, or a list or group as YAML writes them; anything else is a text."""
    if _WHOLE.fullmatch(text):
        return int(text)
    if _NUMBER.fullmatch(text):
        return float(text)
    try:
        return yaml.safe_load(text) if text[:1] in tuple("[{") else {"true": True, "false": False}.get(text.lower(), text)
    except (yaml.YAMLError, ValueError, RecursionError):
        raise ValueError(unreadable(word)) from None


def unreadable(word: str) -> str:
    """Say that a word cannot be read, and how to quote its value."""
    name, equals, value = word.partition("=")
    if not equals:
        return f"cannot read {word!r}; write NAME=VALUE"
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return f"cannot read {word!r}; quote a value with signs in it, as in '{name}=\"{escaped}\"'"


def listed(name: str, words: str, known: Sequence[str]) -> tuple[str, ...]:
    """Read a comma list of names, or `all`, in the order of `known`. Raises ValueError for an unknown name."""
    chosen = known if words == "all" else [word.strip() for word in words.split(",")]
    for word in chosen:
        if word not in known:
            raise ValueError(f"unknown {name} {word!r}; choose from {', '.join(known)}, or all")
    return tuple(word for word in known if word in chosen)


def smoke_budget() -> dict[str, Any]:
    """Read the seeds, iterations and training settings (`train`) of scale=smoke from the one file that states them."""
    file = resources.files("experiments.cli.conf") / "scale" / "smoke.yaml"
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def refuse_short_runs(seeds: int, iterations: int, out: str, results: str) -> None:
    """Raise ValueError for impossible numbers, and for fewer or shorter runs in the folder of the results."""
    at_least("seeds", seeds, 1)
    at_least("iterations", iterations, 0)
    if (seeds != SEEDS or iterations) and Path(out).resolve() == Path(results).resolve():
        raise ValueError(f"seeds={seeds} iterations={iterations}: {results} has {SEEDS} seeds; choose out=DIR")
