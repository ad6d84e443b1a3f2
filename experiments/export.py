"""Write what a run has learned as StableHLO and ONNX: `python -m experiments.export run_dir=runs/swimmer/aircl_corrected`.

run_dir   a run, finished or still training
seed      one of its seeds; by default the first
out       folder for policy, reward, step_feasibility and feasibility, and manifest.json; by default run_dir/export.
          Policy and step_feasibility are written as ONNX too
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
    out: str = "run_dir/export"


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(write, argv, Settings(), __doc__)


def write(settings: Settings, _: Sequence[str]) -> None:
    """Export one seed and print what was written and how exactly it agrees. Raises ValueError for settings that do not fit."""
    if not settings.run_dir:
        raise ValueError("run_dir is missing; give the directory of a run, as in run_dir=runs/swimmer/aircl_corrected")

    from aircl_jax import load
    from aircl_jax.transfer.export import MANIFEST, export_run

    result = load(settings.run_dir)
    seeds = list(result.spec.seeds)
    seed = seeds[0] if settings.seed == "first" else settings.seed
    if seed not in seeds:
        raise ValueError(f"seed={seed} is not in {settings.run_dir}; choose from {', '.join(map(str, seeds))}")
    out = Path(settings.run_dir) / "export" if settings.out == Settings().out else Path(settings.out)
    for name, entry in export_run(result, seeds.index(seed), out)["functions"].items():
        for one in (entry, *([entry["onnx"]] if "onnx" in entry else [])):
            size, worst = (out / one["file"]).stat().st_size / 1000, one["greatest_difference"]
            say(f"wrote {out / one['file']} ({size:.0f} kB): {entry['what']}; {name} agrees to {worst:.0e}")
    say(f"wrote {out / MANIFEST}: shapes, units and hashes")


if __name__ == "__main__":
    sys.exit(main())
