"""Read the tasks of demonstrations=[…]: files, or groups with a source, a name and what differs of the environment."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def tasks_of(demonstrations: Sequence[str | dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the tasks by name, as `aircl_jax.train_tasks` takes them. A file without a name is called by its stem.

    Raises ValueError where two have one name.
    """
    tasks: dict[str, dict[str, Any]] = {}
    for number, entry in enumerate(demonstrations, 1):
        own = dict(entry) if isinstance(entry, Mapping) else {"source": entry}
        source = str(own.pop("source", "default"))
        name = str(own.pop("name", f"task{number}" if source == "default" else Path(source).stem))
        if name in tasks:
            raise ValueError(f"demonstrations: two tasks are called {name}; name one, as in {{source: {source}, name: OTHER}}")
        tasks[name] = {"demonstrations": source, "env_settings": own}
    return tasks
