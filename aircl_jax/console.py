"""Run a command by its short name, from any folder: `aircl run env=gridworld` is `python -m experiments.run env=gridworld`."""

import importlib
import sys
from collections.abc import Sequence
from importlib.util import find_spec

from aircl_jax.messages import say, tell

COMMANDS = {
    "run": "train a method on a world",
    "search": "settings of training, by demonstrations held out",
    "tasks": "several tasks under one constraint beside each alone",
    "watch": "show a robot's run as a film",
    "shield": "put an unconstrained expert behind a learned constraint",
    "export": "write policy, reward and feasibility as StableHLO and ONNX",
    "swap": "are reward and constraint separately right",
    "behaviour": "what recorded animals want and avoid",
    "minari": "write demonstrations as a Minari data set",
    "herd": "make up a herd as a large table",
    "expert": "train a robot's expert and write demonstrations",
    "recovery": "every method on four grids",
    "bodies": "one configuration on bodies that no setting was chosen on",
    "sweeps": "how results depend on settings and demonstrations",
    "table1": "the paper's Table 1",
    "figure2": "the paper's Figure 2",
    "figure3": "the tasks, and each robot's constraint",
    "figure4": "the paper's Figure 4",
    "benchmark": "steps per second on this machine",
    "accelerator": "the same numbers on an accelerator as on the CPU, and how fast",
    "learner": "the learner of swap tests, from scratch, and beside Brax's PPO",
    "physics": "speed and deviation of the physics",
    "pendulum_lqr": "what the pendulum's noise allows",
}
BAD_INPUT = 2
EXTRA = "install aircl-jax["  # ends the message of a package that an extra brings
# In a wheel `experiments` and `envs` are within this package, so that no folder of one's own is in their way.
INSTALLED = "aircl_jax.experiments"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the first word names with the words after it; return its exit code."""
    words = sys.argv[1:] if argv is None else list(argv)
    if not words or words[0] in ("--help", "-h"):
        width = max(map(len, COMMANDS))
        say("aircl COMMAND NAME=VALUE …; aircl COMMAND --help says more\n")
        say("\n".join(f"  {name:{width}}  {what}" for name, what in COMMANDS.items()))
        return 0
    if words[0] not in COMMANDS:
        tell(f"error: unknown command {words[0]!r}; choose from {', '.join(COMMANDS)}")
        return BAD_INPUT
    home = INSTALLED if find_spec(INSTALLED) else INSTALLED.rpartition(".")[2]
    importlib.import_module(home)  # which prepares jax before anything imports it
    module = f"{home}.{words[0]}"
    spec = find_spec(module)
    packaged = spec is not None and spec.submodule_search_locations is not None
    try:
        command = importlib.import_module(f"{module}.__main__" if packaged else module)
    except ImportError as error:
        if EXTRA not in str(error):
            raise
        tell(f"error: {error}")
        return BAD_INPUT
    return command.main(words[1:])


if __name__ == "__main__":
    sys.exit(main())
