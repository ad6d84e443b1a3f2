"""The front door: `train` runs a method on an environment over seeds, with or without a run directory."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, cast

import jax
import jax.numpy as jnp
import numpy as np

from aircl_jax.algorithm.evaluation import evaluate as evaluate_seed
from aircl_jax.algorithm.trainer import Trainer, make_trainer
from aircl_jax.defects import Attempts
from aircl_jax.demonstrations import sources
from aircl_jax.messages import warn
from aircl_jax.model.networks import Networks
from aircl_jax.reports import run_report
from aircl_jax.reports.alarms import alarms, not_finite, untuned
from aircl_jax.reports.summary import fits, summarise
from aircl_jax.runs import world
from aircl_jax.runs.directory import FIGURES, THEN, TRACE, RunDirectory
from aircl_jax.runs.loop import Stopwatch, defects_apart, run_session, since_of
from aircl_jax.runs.opening import existing, open_run, open_saved
from aircl_jax.runs.readers import SUMMARY
from aircl_jax.runs.recorder import DataRecorder, Memory, Recorder, Row
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import make_evaluator, make_runner, relieve, seed_keys
from aircl_jax.runs.spec import RunSpec, make_spec, read_spec
from aircl_jax.runs.stopping import signals_noted
from aircl_jax.settings.checks import check_jax
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.storage import disk
from aircl_jax.transfer.learned import maps_of_learned, measures_of_learned
from aircl_jax.transfer.plans import plans_of
from aircl_jax.types import TrainState, Trajectory
from envs import Env
from envs.animals.data_folder import command_prefix


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
    expert, reference = _demonstrations(spec)
    states = directory.load(_shapes(trainer, spec, expert))
    for remark in directory.remarks:
        warn(remark)
    summary = _kept_summary(directory, spec) if directory.finished else None
    if summary is None:
        evaluation = _evaluator(networks, expert, reference)(states)
        summary = summarise(spec, {**evaluation, **measures_of_learned(spec, networks, states)}, directory.timing())
    return _result(spec, networks, states, expert, reference, summary, directory.history(), directory.path)


def _train(
    spec: RunSpec, directory: RunDirectory | None, command: str, recorders: Sequence[Recorder], notes: Sequence[str]
) -> Result:
    stopwatch = Stopwatch()
    trainer = make_trainer(spec.env, spec.method, spec.config)
    runner, networks = make_runner(trainer, spec.seeds), trainer.networks
    expert, reference = _demonstrations(spec)
    record, opened = directory or Memory(), directory and (directory.start, directory.finished, directory.path)
    start, finished, path = world.from_first(opened) or (0, False, None)
    ours = cast(RunDirectory, directory)  # for what the first process alone does, where there is a path
    saved = None
    if start:
        shapes = _shapes(trainer, spec, expert)
        saved = world.tree_of_first(lambda: ours.load(shapes), shapes)
    if finished and saved and (kept := world.by_first(lambda: _kept_summary(ours, spec))):
        return _result(spec, networks, saved, expert, reference, kept, world.by_first(record.history), path)
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
            evaluate=_evaluator(networks, expert, reference),
            env_steps=spec.env_steps,
            stopwatch=stopwatch,
            recorders=(record, *recorders) if world.is_first() else (),
            since=since_of(record.timing()),
            stop=partial(stop, world.most),
        )
        with defects_apart():
            evaluation = world.by_first(lambda: {**evaluation, **measures_of_learned(spec, networks, states)})
            summary = summarise(spec, evaluation, world.by_first(record.timing))
            result = _result(spec, networks, states, expert, reference, summary, world.by_first(record.history), path)
        if path:
            result = replace(result, defects=world.by_first(lambda: _keep(result, ours, command, stop, notes)))
    relieve()
    return result


def _keep(
    result: Result, directory: RunDirectory, command: str, stop: Callable[[], None], notes: Sequence[str]
) -> tuple[str, ...]:
    """Write the summary, then all that could fail for a fault of ours, and last the report; return what has failed."""
    from aircl_jax.figures import of_a_run
    from aircl_jax.reports.card import as_json, as_markdown, card_of
    from aircl_jax.reports.page import page_of
    from aircl_jax.reports.recovered_words import reading

    spec, attempt = result.spec, Attempts(directory.path / TRACE)
    directory.write_summary(result.summary)
    with disk(directory.path, THEN):
        figures = of_a_run.write_figures(result, directory.path / FIGURES, attempt, stop)
        words = attempt("the reading in plain words", lambda: reading(result), "")
        maps = attempt("the maps", lambda: maps_of_learned(result), {})
        card = attempt("the card", lambda: card_of(result), None)
        plans = attempt("the plans", lambda: plans_of(result), None)
    directory.write_maps(maps)
    if plans is not None:
        directory.write_plans(plans)
    if card is not None:
        card = {**card, "cannot_tell": [*card["cannot_tell"], *notes]}
        directory.write_card(as_json(card), as_markdown(card, f"{spec.method_name} on {spec.env.title}"))
    if command:
        command = command_prefix(spec.env_settings.get("data"), spec.env.simulated) + command
    alarms = [*result.alarms, *attempt.failed]
    account = spec.env.recorded.account if spec.env.recorded is not None else ()
    words = "\n\n".join(filter(None, [words, *notes]))
    report = run_report.report(result.summary, alarms, figures, command, words, account)
    with disk(directory.path, THEN):
        page = attempt("the HTML report", lambda: page_of(directory.path, report), None)
    if page is not None:
        directory.write_page(page)
    directory.write_report(report)
    return tuple(attempt.failed)


def _kept_summary(directory: RunDirectory, spec: RunSpec) -> Mapping[str, Any] | None:
    """Read the summary of a finished run; None, and a line, where the file is damaged and has to be made again."""
    summary = directory.summary()
    if summary is not None and fits(summary, spec):
        return summary
    warn(f"{directory.path / SUMMARY} is damaged; its numbers are measured again")
    return None


def _shapes(trainer: Trainer, spec: RunSpec, expert: Trajectory) -> TrainState:
    """The states' shapes and types, [S, …]."""
    return jax.eval_shape(jax.vmap(trainer.init), seed_keys(spec.seeds), expert)


def _demonstrations(spec: RunSpec) -> tuple[Trajectory, Trajectory]:
    """D_E of every seed, [S, N, T, …], and the reference set: the world's, that beside one's own file, or else D_E itself."""
    if spec.own is None:
        return sources.demonstrations(spec.env, spec.seeds, spec.config)
    shared = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(spec.seeds), *leaf.shape)), spec.own)
    if spec.env.expert is not None:
        return shared, sources.demonstrations(spec.env, spec.seeds, spec.config)[1]
    return shared, spec.own if spec.reference is None else spec.reference


def _evaluator(networks: Networks, expert: Trajectory, reference: Trajectory) -> Callable[[TrainState], Row]:
    """The evaluation of all seeds' states, {metric: [S]}."""
    evaluate = make_evaluator(partial(evaluate_seed, networks), expert.mask.shape[0])
    return lambda states: jax.device_get(world.gathered(evaluate(states, expert, reference)))


def _result(
    spec: RunSpec,
    networks: Networks,
    states: TrainState,
    expert: Trajectory,
    reference: Trajectory,
    summary: Mapping[str, Any],
    history: Mapping[str, np.ndarray],
    path: Path | None,
) -> Result:
    per_seed = {name: {"per_seed": row["per_seed"]} for name, row in summary["metrics"].items()}
    return Result(
        summary=summary,
        alarms=[
            *untuned(spec.env),
            *_of_the_data(spec.env),
            *not_finite(summary),
            *alarms(summary["seeds"], per_seed),
        ],
        history=history,
        spec=spec,
        networks=networks,
        states=states,
        expert=expert,
        reference=reference,
        run_dir=path,
    )


def _of_the_data(env: Env) -> list[str]:
    """What the recorded demonstrations warn of, as alarms."""
    return [] if env.recorded is None else [f"{warning[0].upper()}{warning[1:]}." for warning in env.recorded.warnings]
