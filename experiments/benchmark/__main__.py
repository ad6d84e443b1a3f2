"""Measure the speed on this machine: `python -m experiments.benchmark env=gridworld`; `peer=true` compares with imitation.

The first prints steps per second, start-up, memory, the time of each part of an iteration, and its limit: how much
arithmetic it is, and how long its matrix products alone would take on the same core. `peer=true` measures ten seeds of
aircl_contrast, ten of aircl_corrected, and as many processes of the library imitation (AIRL, in its own Python:
`make .venv-peer/.installed`) as there are cores, on gridworld, swimmer, pendulum and walker. It keeps each world in
results/speed/ and writes results/speed.md; the next call skips kept worlds. Settings, as NAME=VALUE:

env         environment; with peer=true a comma list, by default all four
method      method
seeds       number of seeds
chunk       iterations that are timed; 0 takes the method's own
epochs      epochs of PPO; 0 takes the method's own
integrator  integrator of the robots
peer        true compares; it has env, seeds and the settings below
scale       full, or smoke: a minute a world, which tests the machinery, in runs/speed_smoke
out         folder of the kept worlds; the page is beside it
"""

import shlex
import sys
from collections.abc import Sequence

from experiments.benchmark.settings import Settings
from experiments.cli.command import run_command


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(run, argv, Settings(), __doc__, then="with peer=true the same command continues")


def run(settings: Settings, words: Sequence[str]) -> None:
    """Print the report of one environment, or compare."""
    if settings.peer:
        from experiments.benchmark import comparison

        comparison.make(settings, shlex.join(["python", "-m", "experiments.benchmark", *words]))
    else:
        from experiments.benchmark import one_env

        one_env.report(settings)


if __name__ == "__main__":
    sys.exit(main())
