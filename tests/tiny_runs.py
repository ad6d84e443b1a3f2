"""Settings of the smallest runs, shared so that their programs are compiled once for all tests."""

from typing import Any

ITERATIONS, CHUNK = 10, 2
GRID: dict[str, Any] = {"size": 3, "goal": [2, 2], "obstacles": [[1, 1]], "horizon": 4}
CONFIG: dict[str, Any] = {
    "num_trajectories": 6,
    "num_demonstrations": 5,
    "num_evaluation": 10,
    "pool_factor": 2,
    "hidden": [4, 3],
    "checkpoint_every": CHUNK,
    "ppo": {"num_epochs": 1, "minibatch_size": 24},
    "adversary": {"num_steps": 1},
}
# Of a row that compiles fast, and of one that has every part.
FAST: dict[str, Any] = {"env": "gridworld", "method": "airl", "env_settings": GRID, "seeds": 2, "config": CONFIG}
WHOLE: dict[str, Any] = {**FAST, "method": "aircl_corrected"}
# The same as words of a command.
SMALL = (
    *("env.size=3", "env.goal=[2,2]", "env.obstacles=[[1,1]]", "env.horizon=4", "train.num_trajectories=6"),
    *("train.num_demonstrations=5", "train.num_evaluation=10", "train.pool_factor=2", "train.hidden=[4,3]"),
    *(
        f"train.checkpoint_every={CHUNK}",
        "train.ppo.num_epochs=1",
        "train.ppo.minibatch_size=24",
        "train.adversary.num_steps=1",
    ),
)
WORDS = ["env=gridworld", "method=airl", "seeds=2", f"iterations={ITERATIONS}", *SMALL]
