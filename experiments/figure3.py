"""Draw the tasks with expert and learned paths (Figure 3), and each robot's learned constraint by coordinate.

`python -m experiments.figure3` reads finished runs, such as those of `python -m experiments.table1`.

runs     folder of runs as ENV/METHOD
method   method whose policy is shown
out      folder for figure3.png, constraint_ENV.png and their captions in figure3.md
"""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from aircl_jax.messages import say
from experiments.cli.command import run_command
from experiments.shared.paper import COLUMNS


@dataclass(frozen=True)
class Settings:
    runs: str = "runs/table1"
    method: str = "aircl_corrected"
    out: str = "results/figure3"


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make, argv, Settings(), __doc__)


def make(settings: Settings, words: Sequence[str]) -> None:
    """Draw the figures and print where they are."""
    say(f"wrote {draw(settings, shlex.join(['python', '-m', 'experiments.figure3', *words]))}")


def draw(settings: Settings, command: str) -> Path:
    """Write the figures and figure3.md of the runs that exist. Raises ValueError where none exists."""
    import matplotlib as mpl

    from aircl_jax import load
    from aircl_jax.analysis.coordinate_contributions import contributions, is_additive
    from aircl_jax.analysis.episodes import gather
    from aircl_jax.figures import tasks
    from aircl_jax.figures.robots.coordinate_curves import by_coordinate
    from aircl_jax.figures.style import DPI, STYLE

    places = {env: Path(settings.runs) / env / settings.method for env in COLUMNS}
    there = {env: place for env, place in places.items() if place.is_dir()}
    if not there:
        known = ", ".join(map(str, places.values()))
        raise ValueError(f"runs={settings.runs} has no run of {settings.method}; make one of {known}")
    results = {env: load(place) for env, place in there.items()}
    out = Path(settings.out)
    out.mkdir(parents=True, exist_ok=True)
    lines = ["# The tasks, demonstrated and learned", "", f"`{command}`", ""]
    with mpl.rc_context(STYLE):
        drawings = {"figure3": tasks.tasks(results)}
        for env, result in results.items():
            if is_additive(result):
                drawings[f"constraint_{env}"] = by_coordinate(result, contributions(result, gather(result).policy))
        for name, drawing in drawings.items():
            drawing.figure.savefig(out / f"{name}.png", dpi=DPI)
            lines += [f"![{name}]({name}.png)", "", drawing.caption, ""]
    absent = [env for env in places if env not in there]
    lines += [f"No run yet: {', '.join(absent)}.", ""] if absent else []
    (out / "figure3.md").write_text("\n".join(lines), encoding="utf-8")
    return out / "figure3.md"


if __name__ == "__main__":
    sys.exit(main())
