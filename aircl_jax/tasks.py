"""Several tasks, one constraint: `train_tasks` learns a reward and a policy for each task, and one feasibility for all."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from aircl_jax.algorithm.tasks import check_alike, make_task_trainer
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.outcome import demonstrations_of, evaluator, keep, kept_summary, result_of, shapes_of
from aircl_jax.reports.summary import summarise
from aircl_jax.runs.directory import RunDirectory
from aircl_jax.runs.loop import Stopwatch, defects_apart, run_session, since_of
from aircl_jax.runs.opening import existing, open_run
from aircl_jax.runs.readers import CONFIG
from aircl_jax.runs.recorder import Memory, Recorder, Row
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import make_runner, relieve
from aircl_jax.runs.spec import RunSpec, make_spec
from aircl_jax.runs.stopping import signals_noted
from aircl_jax.settings.checks import check_jax
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.transfer.learned import measures_of_learned
from aircl_jax.types import TrainState
from envs import Env

OF_A_TASK = ("env", "env_settings", "demonstrations")


def train_tasks(
    env: str | Env,
    tasks: Mapping[str, Mapping[str, Any]],
    method: str = "aircl_contrast",
    *,
    seeds: int = 10,
    first_seed: int = 0,
    iterations: Any = "default",
    run_dir: str | Path | None = None,
    env_settings: Mapping[str, Any] | None = None,
    config: TrainConfig | Mapping[str, Any] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    command: str = "",
    recorders: Sequence[Recorder] = (),
) -> dict[str, Result]:
    """Learn a reward and a policy for each task, and one constraint from the demonstrations of all.

    `tasks` has for each name what differs from the others: `demonstrations` and `env_settings`, or an `env` of its own. The
    rest is as for `train`. Each result is that of an ordinary run, and each task has its own folder `run_dir/NAME`, which
    `load` and every command take. `resume` continues all of them. Each of `recorders` is told of every chunk with a task axis
    after that of the seeds. With one task alone this is `train`, number for number.

    Raises:
        ValueError: in one line, before anything is written, for whatever does not fit.
        DiskError, KeyboardInterrupt, Terminated: as for `train`.
    """
    check_jax()
    if jax.process_count() > 1:
        raise ValueError(f"{jax.process_count()} processes: tasks of one constraint are trained in one; start one")
    specs = _specs(env, tasks, method, env_settings or {}, config or {}, (seeds, first_seed, iterations))
    mode, directories = existing(resume, overwrite), None
    if run_dir is not None:
        if (Path(run_dir) / CONFIG).exists():
            raise ValueError(f"run_dir={run_dir} already holds a run of one task; choose another directory")
        chunk = specs[0].config.checkpoint_every
        directories = _from_one_iteration(
            [open_run(Path(run_dir) / name, spec.settings, chunk, mode) for name, spec in zip(tasks, specs, strict=True)]
        )
    return dict(zip(tasks, _train(specs, directories, command, recorders), strict=True))


def _specs(
    env: str | Env,
    tasks: Mapping[str, Mapping[str, Any]],
    method: str,
    env_settings: Mapping[str, Any],
    config: TrainConfig | Mapping[str, Any],
    length: tuple[int, int, Any],
) -> list[RunSpec]:
    """Resolve the settings of each task. Raises ValueError where they do not fit together."""
    if not tasks:
        raise ValueError("tasks is empty; name at least one, with its demonstrations or env_settings")
    seeds, first_seed, iterations = length
    specs = []
    for number, (name, own) in enumerate(tasks.items()):
        if not name or not name.replace("_", "").replace("-", "").isalnum():
            raise ValueError(f"task {name!r} is no name of a folder; choose letters, digits, _ and -")
        for setting in own:
            if setting not in OF_A_TASK:
                raise ValueError(f"tasks.{name}: unknown setting {setting!r}; choose from {', '.join(OF_A_TASK)}")
        try:
            spec = make_spec(
                own.get("env", env),
                method,
                contrast_prior="method",
                seeds=seeds,
                first_seed=first_seed,
                iterations=iterations,
                demonstrations=own.get("demonstrations", "default"),
                env_settings={**env_settings, **own.get("env_settings", {})},
                config=config,
                tasks=tuple(tasks) if len(tasks) > 1 else (),
                task=number,
            )
        except ValueError as error:
            raise ValueError(f"tasks.{name}: {error}") from error
        specs.append(spec)
    check_alike([spec.env for spec in specs], list(tasks), specs[0].method, method)
    _check_numbers(specs)
    return specs


def _train(
    specs: Sequence[RunSpec], directories: Sequence[RunDirectory] | None, command: str, recorders: Sequence[Recorder]
) -> list[Result]:
    stopwatch, count, first = Stopwatch(), len(specs), specs[0]
    trainers = [make_trainer(spec.env, spec.method, spec.config) for spec in specs]
    shown = [demonstrations_of(spec) for spec in specs]
    records: Sequence[Any] = directories or [Memory() for _ in specs]
    evaluators = [evaluator(trainer.networks, *pair) for trainer, pair in zip(trainers, shown, strict=True)]

    def finish(index: int, state: TrainState, summary: Mapping[str, Any]) -> Result:
        networks, path = trainers[index].networks, directories[index].path if directories else None
        return result_of(specs[index], networks, state, *shown[index], summary, records[index].history(), path)

    def evaluate(states: TrainState) -> Row:
        rows = [measure(own) for measure, own in zip(evaluators, parts(states, count), strict=True)]
        return {name: np.stack([row[name] for row in rows], axis=1) for name in rows[0]}

    saved: list[TrainState] = []
    if directories and directories[0].start:
        every = zip(directories, trainers, specs, shown, strict=True)
        saved = [folder.load(shapes_of(trainer, spec, pair[0])) for folder, trainer, spec, pair in every]
        if all(folder.finished for folder in directories):
            kept = [kept_summary(folder, spec) for folder, spec in zip(directories, specs, strict=True)]
            if None not in kept:
                return [finish(index, saved[index], summary) for index, summary in enumerate(kept) if summary is not None]
    experts = joined([expert for expert, _ in shown])
    runner = make_runner(make_task_trainer([spec.env for spec in specs], first.method, first.config), first.seeds)
    with signals_noted() as stop, ExitStack() as held:
        for folder in directories or ():
            held.enter_context(folder.held())
        with defects_apart():
            states = joined(saved) if saved else runner.init(experts)
        states, evaluation = run_session(
            runner,
            states,
            experts,
            start=directories[0].start if directories else 0,
            iterations=first.config.iterations,
            chunk=first.config.checkpoint_every,
            evaluate=evaluate,
            env_steps=count * first.env_steps,
            stopwatch=stopwatch,
            recorders=(_OfTasks(records), *recorders),
            since=since_of(records[0].timing()),
            stop=stop,
        )
        results = []
        with defects_apart():
            for index, (state, row) in enumerate(zip(parts(states, count), parts(evaluation, count), strict=True)):
                measures = {**row, **measures_of_learned(specs[index], trainers[index].networks, state)}
                results.append(finish(index, state, summarise(specs[index], measures, records[index].timing())))
        for index, folder in enumerate(directories or ()):
            results[index] = replace(results[index], defects=keep(results[index], folder, command, stop, ()))
    relieve()
    return results


@dataclass(frozen=True)
class _OfTasks:
    """Give each task's recorder the part of a chunk that is its own."""

    records: Sequence[Recorder]

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        count = len(self.records)
        own = {**timing, "env_steps": timing["env_steps"] // count}
        every = zip(self.records, parts(states, count), zip(*(parts(row, count) for row in rows), strict=True), strict=True)
        for record, state, of_task in every:
            record.on_chunk(iteration, state, of_task, own)


def parts(tree: Any, count: int) -> list[Any]:
    """Part a tree [S, K, …] into one of each task, [S, …]."""
    return [jax.tree.map(lambda leaf, index=index: leaf[:, index], tree) for index in range(count)]


def joined(trees: Sequence[Any]) -> Any:
    """Join trees of each task, [S, …], to one, [S, K, …]."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves, axis=1), *trees)


def _from_one_iteration(directories: Sequence[RunDirectory]) -> list[RunDirectory]:
    """Let all tasks go on from the iteration that every one of them has reached."""
    start = min(folder.start for folder in directories)
    return [folder if folder.start == start else replace(folder, start=start, finished=False) for folder in directories]


def _check_numbers(specs: Sequence[RunSpec]) -> None:
    """Raise ValueError where tasks have not as many demonstrations each."""
    numbers = [spec.config.num_demonstrations if spec.own is None else spec.own.mask.shape[0] for spec in specs]
    for spec, number in zip(specs, numbers, strict=True):
        if number != numbers[0]:
            name, first = spec.tasks[spec.task], f"of {spec.tasks[0]} {numbers[0]}"
            raise ValueError(f"tasks.{name}: {number} demonstrations, {first}; give each task as many")
