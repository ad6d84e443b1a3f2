"""key=value words of the commands that need no Hydra: types and choices come from a dataclass of settings."""

from collections.abc import Sequence
from typing import Any, TypeVar

import yaml

from aircl_jax.settings import updated

T = TypeVar("T")


def parse(words: Sequence[str], default: T, about: str | None) -> T:
    """The settings with these words in place of their own; `--help` prints `about` and ends.

    Raises ValueError, in one line, for what does not fit.
    """
    if "--help" in words:
        print(about)
        raise SystemExit(0)
    given: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"cannot read {word!r}; write NAME=VALUE")
        given[name] = yaml.safe_load(value)
    return updated(default, given)
