"""Train by imitation's AIRL and time its rounds. Runs in .venv-peer, without this project; `theirs.py` calls it.

It prints `ready` after a first round and waits for a line, so that several processes are timed while all of them train.
"""

import json
import sys
import tempfile
import time
from typing import Any

import gymnasium
import numpy as np
import torch
from imitation.algorithms.adversarial.airl import AIRL
from imitation.data.types import Trajectory
from imitation.rewards.reward_nets import BasicRewardNet
from imitation.util import logger
from imitation.util.networks import RunningNorm
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

ENVS = 10  # environments in one process, as in the library's examples


class Grid(gymnasium.Env):
    """A finite world by its tables. One sees what the table shows of the state, and the share of the time that has gone."""

    def __init__(self, file: str, horizon: int) -> None:
        tables = np.load(file)
        self.cumulative, self.start, self.seen = tables["transition"].cumsum(-1), tables["start"], tables["obs"]
        self.horizon, self.state, self.t = horizon, 0, 0
        self.observation_space = gymnasium.spaces.Box(0.0, 1.0, (self.seen.shape[1] + 1,), np.float64)
        self.action_space = gymnasium.spaces.Discrete(self.cumulative.shape[1])

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.state, self.t = int(self.np_random.choice(len(self.start), p=self.start / self.start.sum())), 0
        return self.observed(), {}

    def step(self, action: Any) -> Any:
        successors = self.cumulative[self.state, int(action)]
        drawn = np.searchsorted(successors, self.np_random.random() * successors[-1], side="right")
        self.state, self.t = int(drawn), self.t + 1
        return self.observed(), 0.0, False, self.t >= self.horizon, {}

    def observed(self) -> Any:
        return np.append(self.seen[self.state], self.t / self.horizon)


class FixedHorizon(gymnasium.Wrapper):
    """Continue an episode after a fall."""

    def step(self, action: Any) -> Any:
        obs, reward, _, truncated, info = self.env.step(action)
        return obs, reward, False, truncated, info


def make_env(settings: dict[str, Any]) -> Any:
    """Make the grid, or Gymnasium's body with a fixed horizon, which imitation needs."""
    name, horizon = settings["env"], settings["horizon"]
    if settings["tables"]:
        return Grid(settings["tables"], horizon)
    free = {"terminate_when_unhealthy": False} if name == "Walker2d-v4" else {}
    world = gymnasium.make(name, max_episode_steps=horizon, **free)
    return FixedHorizon(world) if name == "InvertedPendulum-v4" else world


def read_demonstrations(settings: dict[str, Any], space: Any) -> list[Trajectory]:
    """Read the demonstrations as imitation has them; what follows the last step, which no file has, is the last observation."""
    file = np.load(settings["demonstrations"])
    every = []
    for obs, action in zip(file["obs"].astype(np.float64), file["action"], strict=True):
        seen, taken = np.concatenate([obs, obs[-1:]]), action
        if settings["tables"]:
            seen = np.concatenate([seen, np.linspace(0.0, 1.0, len(seen))[:, None]], axis=1)
        else:
            taken = np.clip(action.astype(np.float32), space.low, space.high)
        every.append(Trajectory(seen, taken, None, terminal=False))
    return every


def make_trainer(settings: dict[str, Any], folder: str) -> Any:
    """Make AIRL on PPO with these settings."""
    venv = DummyVecEnv([lambda: make_env(settings)] * ENVS)
    venv.seed(settings["seed"])
    a_round = settings["trajectories"] * settings["horizon"]
    demonstrations = read_demonstrations(settings, venv.action_space)
    policy = PPO(
        "MlpPolicy",
        venv,
        n_steps=a_round // ENVS,
        batch_size=min(settings["minibatch"], a_round),
        n_epochs=settings["epochs"],
        policy_kwargs={"net_arch": list(settings["hidden"])},
        device="cpu",
        seed=settings["seed"],
    )
    reward = BasicRewardNet(
        venv.observation_space, venv.action_space, hid_sizes=tuple(settings["hidden"]), normalize_input_layer=RunningNorm
    )
    return AIRL(
        demonstrations=demonstrations,
        demo_batch_size=min(settings["judged"], sum(len(one.acts) for one in demonstrations)),
        venv=venv,
        gen_algo=policy,
        reward_net=reward,
        n_disc_updates_per_round=settings["steps"],
        gen_train_timesteps=a_round,
        allow_variable_horizon=True,
        custom_logger=logger.configure(folder, format_strs=[]),
    )


def state_of(world: Any) -> Any:
    """The state of a world, [S]: positions and velocities of a body, or the number of a grid's."""
    bare = world.unwrapped
    return np.array([bare.state]) if isinstance(bare, Grid) else np.concatenate([bare.data.qpos, bare.data.qvel])


def play(policy: Any, worlds: list[Any], horizon: int) -> tuple[Any, Any]:
    """Play an episode in each world by draws of the policy; return states, [N, T + 1, S], and actions, [N, T, …]."""
    obs = np.stack([world.reset()[0] for world in worlds])
    states, actions = [[state_of(world) for world in worlds]], []
    for _ in range(horizon):
        action, _ = policy.predict(obs, deterministic=False)
        obs = np.stack([world.step(one)[0] for world, one in zip(worlds, action, strict=True)])
        states.append([state_of(world) for world in worlds])
        actions.append(action)
    return np.array(states).swapaxes(0, 1), np.array(actions).swapaxes(0, 1)


def main() -> None:
    settings = json.loads(sys.argv[1])
    torch.set_num_threads(1)
    a_round, seconds, played = settings["trajectories"] * settings["horizon"], [], []
    with tempfile.TemporaryDirectory() as folder:
        trainer = make_trainer(settings, folder)
        worlds = [make_env(settings) for _ in range(settings["episodes"])]
        for number, world in enumerate(worlds):
            world.reset(seed=1000 * (1 + settings["seed"]) + number)
        start_s = time.time() - settings["started"]
        trainer.train(a_round)
        print("ready", flush=True)
        sys.stdin.readline()
        begun = time.perf_counter()
        while len(seconds) < settings["rounds"] or time.perf_counter() - begun < settings["seconds"]:
            start = time.perf_counter()
            trainer.train(a_round)
            seconds.append(time.perf_counter() - start)
            if worlds:
                played.append(play(trainer.gen_algo, worlds, settings["horizon"]))
    if played:
        states, actions = zip(*played, strict=True)
        np.savez(settings["played"], states=np.array(states), actions=np.array(actions))
    print(json.dumps({"start_s": start_s, "round_s": seconds}), flush=True)


if __name__ == "__main__":
    main()
