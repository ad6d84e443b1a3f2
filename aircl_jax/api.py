"""The front door: `train` runs a method on an environment over seeds, with or without a run directory."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, cast

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.messages import warn
from aircl_jax.outcome import demonstrations_of, evaluator, keep, kept_summary, result_of, shapes_of
from aircl_jax.reports.summary import summarise
from aircl_jax.runs import world
from aircl_jax.runs.directory import RunDirectory
from aircl_jax.runs.loop import Stopwatch, defects_apart, run_session, since_of
from aircl_jax.runs.opening import existing, open_run, open_saved
from aircl_jax.runs.recorder import DataRecorder, Memory, Recorder
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import make_runner, relieve
from aircl_jax.runs.spec import RunSpec, make_spec, read_spec
from aircl_jax.runs.stopping import signals_noted
from aircl_jax.settings.checks import check_jax
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.transfer.learned import measures_of_learned
from envs import Env


def train(
    env: str | Env = "gridworld",
    method: str = "default",
    *,
    seeds: int = 10,
    first_seed: int = 0,
    iterations: int | Literal["default"] = "default",
    run_dir: str | Path | None = None,
    demonstrations: str | Path = "default",
    contrast_prior: Literal["method", "on", "off"] = "method",
    env_settings: Mapping[str, Any] | None = None,
    config: TrainConfig | Mapping[str, Any] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    command: str = "",
    recorders: Sequence[Recorder] = (),
    notes: Sequence[str] = (),
) -> Result:
    """Learn a reward, a constraint and a policy from demonstrations.

    By default `method`, `iterations`, `demonstrations` and `config` are the environment's own; `config` may be a nested mapping
    of the fields to change. With `run_dir` everything is also kept there, and `resume` continues it.
    Each of `recorders` is told of every chunk, after it has been kept; what one of them raises ends the run. In a world of
    processes all of them call this and have the result; the first one alone reads and writes `run_dir` and has recorders.
    `notes` are sentences that the run's report and card repeat.

    Raises:
        ValueError: in one line, before anything is written, for whatever does not fit.
        DiskError: in one line, where the disk is full, read-only or gone; what is saved stays.
        KeyboardInterrupt, Terminated: after SIGINT, after SIGTERM or SIGHUP, once the chunk under way is saved.
    """
    check_jax()
    spec = make_spec(
        env,
        method,
        contrast_prior=contrast_prior,
        seeds=seeds,
        first_seed=first_seed,
        iterations=iterations,
        demonstrations=demonstrations,
        env_settings=env_settings or {},
        config=config or {},
    )
    directory = None
    if run_dir is not None:
        mode, chunk = existing(resume, overwrite), spec.config.checkpoint_every
        directory = world.in_first(lambda: open_run(Path(run_dir), spec.settings, chunk, mode))
    return _train(spec, directory, command, recorders, notes)


def load(run_dir: str | Path) -> Result:
    """What a run has learned so far, from its newest checkpoint; writes nothing.

    A run that is still going on has no summary yet: its states are then evaluated as at the end.

    Raises:
        ValueError: in one line, where there is no run, or none that this version can read.
    """
    directory = open_saved(Path(run_dir))
    spec = read_spec({**directory.settings, "iterations": directory.start})
    trainer = make_trainer(spec.env, spec.method, spec.config)
    networks = trainer.networks
    expert, reference = demonstrations_of(spec)
    states = directory.load(shapes_of(trainer, spec, expert))
    for remark in directory.remarks:
        warn(remark)
    summary = kept_summary(directory, spec) if directory.finished else None
    if summary is None:
        evaluation = evaluator(networks, expert, reference)(states)
        summary = summarise(spec, {**evaluation, **measures_of_learned(spec, networks, states)}, directory.timing())
    return result_of(spec, networks, states, expert, reference, summary, directory.history(), directory.path)


def _train(
    spec: RunSpec, directory: RunDirectory | None, command: str, recorders: Sequence[Recorder], notes: Sequence[str]
) -> Result:
    stopwatch = Stopwatch()
    trainer = make_trainer(spec.env, spec.method, spec.config)
    runner, networks = make_runner(trainer, spec.seeds), trainer.networks
    expert, reference = demonstrations_of(spec)
    record, opened = directory or Memory(), directory and (directory.start, directory.finished, directory.path)
    start, finished, path = world.from_first(opened) or (0, False, None)
    ours = cast(RunDirectory, directory)  # for what the first process alone does, where there is a path
    saved = None
    if start:
        shapes = shapes_of(trainer, spec, expert)
        saved = world.tree_of_first(lambda: ours.load(shapes), shapes)
    if finished and saved and (kept := world.by_first(lambda: kept_summary(ours, spec))):
        return result_of(spec, networks, saved, expert, reference, kept, world.by_first(record.history), path)
    for recorder in recorders:
        if spec.env.recorded is not None and isinstance(recorder, DataRecorder):
            recorder.on_data(spec.env.recorded.account, spec.env.recorded.warnings)
    with signals_noted() as stop, ExitStack() as held:
        world.in_first(lambda: held.enter_context(directory.held()) if directory else None)
        with defects_apart():
            states = saved or runner.init(expert)
        states, evaluation = run_session(
            runner,
            states,
            expert,
            start=start,
            iterations=spec.config.iterations,
            chunk=spec.config.checkpoint_every,
            evaluate=evaluator(networks, expert, reference),
            env_steps=spec.env_steps,
            stopwatch=stopwatch,
            recorders=(record, *recorders) if world.is_first() else (),
            since=since_of(record.timing()),
            stop=partial(stop, world.most),
        )
        with defects_apart():
            evaluation = world.by_first(lambda: {**evaluation, **measures_of_learned(spec, networks, states)})
            summary = summarise(spec, evaluation, world.by_first(record.timing))
            result = result_of(spec, networks, states, expert, reference, summary, world.by_first(record.history), path)
        if path:
            result = replace(result, defects=world.by_first(lambda: keep(result, ours, command, stop, notes)))
    relieve()
    return result
