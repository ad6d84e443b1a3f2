"""Put an unconstrained expert behind the shield of a run: `python -m experiments.shield run_dir=runs/swimmer/aircl_corrected`.

run_dir   a finished run on a robot whose constraint reads actions
expert    clone: of the unconstrained episodes that ship with the robot; or the folder of a run of experiments.expert
seed      one of the run's seeds; by default all of them, one after the other
by        limits, sum or draws: how a replacement is found; by default the first of them that the run allows
episodes  fresh episodes of each controller
out       folder for shield.md and shield.json; by default the run's folder
"""

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from aircl_jax.messages import say
from envs.settings import at_least
from experiments.cli.command import run_command


@dataclass(frozen=True)
class Settings:
    run_dir: str = ""
    expert: str = "clone"
    seed: int | Literal["all"] = "all"
    by: Literal["default", "limits", "sum", "draws"] = "default"
    episodes: int = 100
    out: str = "run_dir"

    def __post_init__(self) -> None:
        at_least("episodes", self.episodes, 1)


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(run, argv, Settings(), __doc__)


def run(settings: Settings, words: Sequence[str]) -> None:
    """Measure, print and write."""
    from aircl_jax.storage import write_whole
    from experiments.shield.report import as_markdown

    found = compared(settings) | {"command": shlex.join(["python", "-m", "experiments.shield", *words])}
    out = Path(settings.run_dir if settings.out == Settings().out else settings.out)
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "shield.json", json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    text = as_markdown(found)
    write_whole(out / "shield.md", text)
    say(text + f"\n{out / 'shield.md'}")


def compared(settings: Settings) -> dict[str, Any]:
    """Measure the expert alone, behind the shield of each seed and, where the truth is known, behind the true limit."""
    if not settings.run_dir:
        raise ValueError("run_dir is missing; give the directory of a run, as in run_dir=runs/swimmer/aircl_corrected")

    import jax
    import jax.numpy as jnp

    from aircl_jax import load, shield
    from experiments.shield import episodes
    from experiments.shield.controllers import controller_of

    result = load(settings.run_dir)
    env, seeds = result.spec.env, list(result.spec.seeds)
    if settings.seed != "all" and settings.seed not in seeds:
        raise ValueError(f"seed={settings.seed} is not in {settings.run_dir}; choose from {', '.join(map(str, seeds))}, or all")
    chosen = seeds if settings.seed == "all" else [settings.seed]
    shields = {seed: shield(result, seeds.index(seed), by=settings.by) for seed in chosen}
    controller, about = controller_of(settings.expert, env)
    decides = {"alone": episodes.unshielded(controller)}
    wrapped = {f"behind the shield, seed {seed}": wrap(controller) for seed, wrap in shields.items()}
    decides |= {name: shielded.decide for name, shielded in wrapped.items()}
    if env.limit is not None and env.limit.bounds == "actions":
        value = env.limit.value
        clipped = episodes.unshielded(lambda obs, key: jnp.clip(controller(obs, key), -value, value))
        decides["behind the true limit"] = clipped
    obs = env.reset(jax.random.key(0))[1]
    rows = {}
    for name, decide in decides.items():
        say(f"{name} …")
        rows[name] = episodes.measured(env, decide, settings.episodes)._asdict()
        rows[name]["microseconds"] = episodes.microseconds(decide, obs)
    return {
        "env": env.title,
        "method": result.spec.method_name,
        "controller": about,
        "judged_by": {name: shielded.judge.words for name, shielded in wrapped.items()},
        "episodes": settings.episodes,
        "rows": rows,
    }


if __name__ == "__main__":
    sys.exit(main())
