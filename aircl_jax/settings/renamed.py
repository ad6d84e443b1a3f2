"""Settings that were once called otherwise, or that are gone: one table, by which files of before are read."""

from collections.abc import Mapping
from typing import Any

from envs.settings import flatten

# Old → new, with their groups. The last part alone has changed; None: it is no setting any more.
RENAMED: Mapping[str, str | None] = {
    "train.waiting": "train.policy_delay",
    "train.annealing": "train.lr_decay_iterations",
    "train.warm_start": "train.clone_epochs",
    "train.warm_minibatch_size": "train.clone_minibatch_size",
    "train.pool": "train.pool_factor",
    "train.chunk": "train.checkpoint_every",
    "train.moments.averaged_from": None,  # θ is chosen once, and no mean is taken
    "train.coefficients.cost_budget": None,  # α of Eq. 10, a constant: it moved the objective and no gradient
}


def renamed(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Give nested settings of before their names of today, and leave out what is gone."""
    today: dict[str, Any] = {}
    for name, value in settings.items():
        full = f"{prefix}.{name}" if prefix else name
        now = RENAMED.get(full, full)
        if now is not None:
            today[now.rpartition(".")[2]] = renamed(value, full) if isinstance(value, Mapping) else value
    return today


def old_name(full: str) -> str | None:
    """Say what has become of a setting, groups included; None where its name is none of before."""
    if full not in RENAMED:
        return None
    new = RENAMED[full]
    return f"unknown setting {full}; " + (f"it is called {new} now" if new else "it is gone, for it changed nothing")


def refuse_old_names(settings: Mapping[str, Any], prefix: str) -> None:
    """Raises ValueError for the first setting that has another name today, or that is gone."""
    for name in flatten(settings, prefix):
        if line := old_name(name):
            raise ValueError(line)
