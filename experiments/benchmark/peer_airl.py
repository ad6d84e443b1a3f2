"""Measure the steps per second of imitation's AIRL. Runs in .venv-peer, without this project; `__main__.py` calls it."""

import json
import sys
import time
from typing import Any

import gymnasium
import numpy as np
import torch
from imitation.algorithms.adversarial.airl import AIRL
from imitation.data.types import Trajectory
from imitation.rewards.reward_nets import BasicRewardNet
from imitation.util.networks import RunningNorm
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

ENVS = 10  # environments in one process, as in the library's examples
ROUNDS = 3  # rounds of training; the first one warms up and is left out


def make_env(name: str, horizon: int) -> Any:
    """Make Gymnasium's body with a fixed horizon, which imitation needs."""
    free = {"terminate_when_unhealthy": False} if name in ("Walker2d-v4", "Hopper-v4") else {}
    world = gymnasium.make(name, max_episode_steps=horizon, **free)
    return FixedHorizon(world) if name == "InvertedPendulum-v4" else world


class FixedHorizon(gymnasium.Wrapper):
    """Continue an episode after a fall."""

    def step(self, action: Any) -> Any:
        obs, reward, _, truncated, info = self.env.step(action)
        return obs, reward, False, truncated, info


def main() -> None:
    settings = json.loads(sys.argv[1])
    torch.set_num_threads(2)
    file = np.load(settings["demonstrations"])
    demonstrations = [
        Trajectory(np.concatenate([obs, obs[-1:]]), np.clip(action, -1, 1), None, terminal=False)
        for obs, action in zip(file["obs"].astype(np.float64), file["action"].astype(np.float32), strict=True)
    ]
    venv = DummyVecEnv([lambda: make_env(settings["env"], settings["horizon"])] * ENVS)
    a_round = settings["trajectories"] * settings["horizon"]
    policy = PPO(
        "MlpPolicy",
        venv,
        n_steps=a_round // ENVS,
        batch_size=settings["minibatch"],
        n_epochs=settings["epochs"],
        policy_kwargs={"net_arch": list(settings["hidden"])},
        device="cpu",
    )
    reward = BasicRewardNet(
        venv.observation_space, venv.action_space, hid_sizes=tuple(settings["hidden"]), normalize_input_layer=RunningNorm
    )
    trainer = AIRL(
        demonstrations=demonstrations,
        demo_batch_size=settings["judged"],
        venv=venv,
        gen_algo=policy,
        reward_net=reward,
        n_disc_updates_per_round=settings["steps"],
        gen_train_timesteps=a_round,
        allow_variable_horizon=True,
    )
    ends = []
    trainer.train(a_round * ROUNDS, callback=lambda _: ends.append(time.perf_counter()))
    print(a_round * (len(ends) - 1) / (ends[-1] - ends[0]))


if __name__ == "__main__":
    main()
