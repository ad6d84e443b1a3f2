"""Write demonstrations as a Minari data set: `python -m experiments.minari env=swimmer minari=own/swimmer-v0`.

minari           id of the data set to make, kept where MINARI_DATASETS_PATH says
env              the world that they are of
env_settings     its settings, as in env_settings={constraint: position}
demonstrations   an .npz of it; by default those that ship
format           arrow or hdf5
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from aircl_jax.messages import say
from experiments.cli.command import run_command


@dataclass(frozen=True)
class Settings:
    minari: str = ""
    env: str = "swimmer"
    env_settings: dict = field(default_factory=dict)
    demonstrations: str = "shipped"
    format: Literal["arrow", "hdf5"] = "arrow"


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(write, argv, Settings(), __doc__)


def write(settings: Settings, _: Sequence[str]) -> None:
    """Read, check and write. Raises ValueError, in one line, for settings that do not fit."""
    from aircl_jax.demonstrations import files
    from aircl_jax.demonstrations.minari_data import write_minari
    from aircl_jax.demonstrations.sources import load_shipped
    from envs import Shipped, make_env

    if not settings.minari:
        raise ValueError("minari is missing; name the data set, as in minari=own/swimmer-v0")
    env = make_env(settings.env, **settings.env_settings)
    if settings.demonstrations != "shipped":
        trajectories = files.load(settings.demonstrations, env)
        origin = Path(settings.demonstrations).name
    elif isinstance(env.expert, Shipped):
        trajectories, origin = load_shipped(env.expert.name, env), f"{env.expert.name}.npz, which ships with aircl-jax"
    else:
        raise ValueError(f"env={settings.env} ships no demonstrations; give some with demonstrations=FILE")
    about = f"Demonstrations of {env.title}: {origin}. Where the true cost of a step is known, it is in its infos."
    write_minari(settings.minari, trajectories, env, about, settings.format)
    number, name = len(trajectories.mask), settings.minari
    say(f"wrote {name}: {number} episodes of {env.title}; read it with demonstrations=minari:{name}")


if __name__ == "__main__":
    sys.exit(main())
