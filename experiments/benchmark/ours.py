"""Time the training of ten seeds by its parts, in a process of its own, which `comparison.py` starts.

A whole run of a robot takes minutes, and every iteration does the same work, but for those of `aircl_contrast` in which its
twin does not yet go its own way. So a run is the sum of its iterations, evaluations and checkpoints.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

from experiments.shared.fresh_seeds import first_seed_of
from experiments.shared.memory import most_memory


def in_a_process(world: str, method: str, **words: Any) -> dict[str, Any]:
    """Measure in a new process that finds nothing compiled before. Raises RuntimeError where it fails."""
    with tempfile.TemporaryDirectory() as cache:
        given = json.dumps({"env": world, "method": method, **words, "started": time.time()})
        done = subprocess.run(
            [sys.executable, "-m", "experiments.benchmark.ours", given],
            env={**os.environ, "JAX_COMPILATION_CACHE_DIR": cache},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["without a word"])[-1]
        raise RuntimeError(f"training {method} on {world} ended with {done.returncode}: {last}")
    return json.loads(done.stdout.splitlines()[-1])


def spec_of(world: str, method: str, seeds: int, training: Mapping[str, Any]) -> Any:
    """Make the run of a world: a row of Table 1, with its own seeds."""
    from aircl_jax.runs.spec import make_spec

    return make_spec(
        world,
        method,
        contrast_prior="method",
        seeds=seeds,
        first_seed=first_seed_of(world, method),
        iterations="default",
        demonstrations="default",
        env_settings={},
        config=training,
    )


def measured(words: Mapping[str, Any]) -> dict[str, Any]:
    """Time iterations, evaluations and checkpoints; `start_s` is what the first ones take beyond the later ones.

    A second chunk belongs to the start, for what it is given may be of other types than what the first one is.
    """
    import jax

    from aircl_jax.algorithm.trainer import make_trainer
    from aircl_jax.outcome import demonstrations_of, evaluator
    from aircl_jax.runs.opening import open_run
    from aircl_jax.runs.seeds import make_runner

    spec = spec_of(words["env"], words["method"], words["seeds"], words["train"])
    config, repeats = spec.config, words["repeats"]
    length = max(1, min(config.checkpoint_every, words["steps"] // spec.env_steps))
    trainer = make_trainer(spec.env, spec.method, config)
    runner, (expert, reference) = make_runner(trainer, spec.seeds), demonstrations_of(spec)
    evaluate = evaluator(trainer.networks, expert, reference)
    states = runner.init(expert)

    def iterate() -> None:
        nonlocal states
        states, metrics = runner.run_chunk(states, expert, length)
        jax.block_until_ready(states)
        jax.device_get(metrics)

    with tempfile.TemporaryDirectory() as place:
        directory = open_run(Path(place) / "run", spec.settings, config.checkpoint_every)
        with directory.held():
            saved = iter(range(1, 2 + repeats))

            def save() -> None:
                directory.save(states, next(saved))

            iterate()
            evaluate(states)
            save()
            iterate()
            first = time.time() - words["started"]
            chunk_s, evaluation_s = timed(iterate, repeats), timed(lambda: evaluate(states), repeats)
            checkpoint_s, twin_s = timed(save, repeats), []
            if spec.method.has_twin:
                states = with_twin(states)
                twin_s = timed(iterate, repeats + 1)[1:]
    steady = 2 * median(chunk_s) + median(evaluation_s) + median(checkpoint_s)
    return {
        "seeds": list(spec.seeds),
        "iterations": config.iterations,
        "steps_an_iteration": spec.env_steps,
        "checkpoints": -(-config.iterations // config.checkpoint_every),
        "twin_from": config.feasibility_delay if twin_s else 0,
        "start_s": round(max(0.0, first - steady), 2),
        "iteration_s": [round(seconds / length, 5) for seconds in chunk_s],
        "twin_iteration_s": [round(seconds / length, 5) for seconds in twin_s],
        "evaluation_s": [round(seconds, 4) for seconds in evaluation_s],
        "checkpoint_s": [round(seconds, 4) for seconds in checkpoint_s],
        "memory": most_memory(),
    }


def timed(run: Callable[[], Any], repeats: int) -> list[float]:
    """Return the seconds of each repeat."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return seconds


def with_twin(states: Any) -> Any:
    """Let the twin of every seed begin."""
    contrast = states.adversary_opt
    return states._replace(adversary_opt=contrast._replace(since=contrast.since + 1.0))


if __name__ == "__main__":
    print(json.dumps(measured(json.loads(sys.argv[1]))))
