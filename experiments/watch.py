"""Write a player and a film strip of a robot's run: `python -m experiments.watch run_dir=runs/swimmer/aircl_corrected`.

run_dir   a run on a robot, finished or still training
seed      one of its seeds; by default the first
episodes  number of demonstrations, and of episodes of the learned policy
out       folder for watch.html, which plays in any browser, and film_strip.png; by default the run's figures
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from aircl_jax.messages import say
from experiments.cli.command import run_command


@dataclass(frozen=True)
class Settings:
    run_dir: str = ""
    seed: int | Literal["first"] = "first"
    episodes: int = 3
    out: str = "run_dir/figures"


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(show, argv, Settings(), __doc__)


def show(settings: Settings, _: Sequence[str]) -> None:
    """Write the player and the film strip, and print where they are. The run's HTML report then has the player inside."""
    for path, caption in watch(settings):
        say(f"wrote {path} ({path.stat().st_size / 1000:.0f} kB): {caption}")


def watch(settings: Settings) -> list[tuple[Path, str]]:
    """Write the two files and return each with a sentence on it. Raises ValueError for settings that do not fit."""
    from aircl_jax.runs.directory import FIGURES
    from aircl_jax.runs.opening import open_saved
    from aircl_jax.runs.spec import read_spec
    from envs.robots.tasks import ROBOTS

    if not settings.run_dir:
        raise ValueError("run_dir is missing; give the directory of a run, as in run_dir=runs/swimmer/aircl_corrected")
    if settings.episodes < 1:
        raise ValueError(f"episodes={settings.episodes} is not at least 1")
    run_dir = Path(settings.run_dir)
    spec = read_spec(open_saved(run_dir).settings)
    env, first, number = spec.env.name, spec.seeds[0], len(spec.seeds)
    if env not in ROBOTS:
        raise ValueError(f"run_dir={run_dir} is a run on {env}, which has no body; choose a run on {', '.join(ROBOTS)}")
    index = 0 if settings.seed == "first" else settings.seed - first
    if not 0 <= index < number:
        choices = ", ".join(str(seed) for seed in range(first, first + number))
        raise ValueError(f"seed={settings.seed} is not in {run_dir}; choose from {choices}")
    out = run_dir / FIGURES if settings.out == Settings().out else Path(settings.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"out={out} cannot be written: {error.strerror}; choose another folder") from error
    return _write(run_dir, index, settings.episodes, out)


def _write(run_dir: Path, index: int, episodes: int, out: Path) -> list[tuple[Path, str]]:
    import matplotlib as mpl

    from aircl_jax import load
    from aircl_jax.analysis import robot_scene
    from aircl_jax.figures.robots import film_strip, player
    from aircl_jax.figures.style import DPI, STYLE
    from aircl_jax.reports.page import page_of
    from aircl_jax.runs.directory import FIGURES, PAGE
    from aircl_jax.storage import write_whole

    scene = robot_scene.gather(load(run_dir), index, episodes)
    film, page = out / "film_strip.png", out / "watch.html"
    page.write_text(player.page(scene), encoding="utf-8")
    with mpl.rc_context(STYLE):
        drawing = film_strip.film_strip(scene)
        drawing.figure.savefig(film, dpi=DPI)
    number = len(scene.expert.length)
    if (run_dir / PAGE).exists() and out == run_dir / FIGURES:
        write_whole(run_dir / PAGE, page_of(run_dir))
    return [(page, f"{number} episodes of demonstrations and policy; open it in a browser."), (film, drawing.caption)]


if __name__ == "__main__":
    sys.exit(main())
