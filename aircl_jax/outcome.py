"""What surrounds the training of a run: its demonstrations, its evaluation, its result, and what is kept of it at the end."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from aircl_jax.algorithm.evaluation import evaluate as evaluate_seed
from aircl_jax.algorithm.trainer import Trainer
from aircl_jax.defects import Attempts
from aircl_jax.demonstrations import sources
from aircl_jax.messages import warn
from aircl_jax.model.networks import Networks
from aircl_jax.reports import run_report
from aircl_jax.reports.alarms import alarms, not_finite, untuned
from aircl_jax.reports.summary import fits
from aircl_jax.runs import world
from aircl_jax.runs.directory import FIGURES, THEN, TRACE, RunDirectory
from aircl_jax.runs.readers import SUMMARY
from aircl_jax.runs.recorder import Row
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import make_evaluator, seed_keys
from aircl_jax.runs.spec import RunSpec
from aircl_jax.storage import disk
from aircl_jax.transfer.learned import maps_of_learned
from aircl_jax.transfer.plans import plans_of
from aircl_jax.types import TrainState, Trajectory
from envs import Env
from envs.animals.data_folder import command_prefix


def keep(
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


def kept_summary(directory: RunDirectory, spec: RunSpec) -> Mapping[str, Any] | None:
    """Read the summary of a finished run; None, and a line, where the file is damaged and has to be made again."""
    summary = directory.summary()
    if summary is not None and fits(summary, spec):
        return summary
    warn(f"{directory.path / SUMMARY} is damaged; its numbers are measured again")
    return None


def shapes_of(trainer: Trainer, spec: RunSpec, expert: Trajectory) -> TrainState:
    """The states' shapes and types, [S, …]."""
    shapes = jax.eval_shape(jax.vmap(trainer.init), seed_keys(spec.seeds), expert)
    if spec.tasks and spec.method.tests_entries:
        evidence = jax.ShapeDtypeStruct((len(spec.seeds), 2, spec.env.obs_size), jnp.float32)
        shapes = shapes._replace(params=shapes.params._replace(evidence=evidence))
    return shapes


def demonstrations_of(spec: RunSpec) -> tuple[Trajectory, Trajectory]:
    """D_E of every seed, [S, N, T, …], and the reference set: the world's, that beside one's own file, or else D_E itself."""
    if spec.own is None:
        return sources.demonstrations(spec.env, spec.seeds, spec.config, spec.task)
    shared = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(spec.seeds), *leaf.shape)), spec.own)
    if spec.env.expert is not None:
        return shared, sources.demonstrations(spec.env, spec.seeds, spec.config, spec.task)[1]
    return shared, spec.own if spec.reference is None else spec.reference


def evaluator(networks: Networks, expert: Trajectory, reference: Trajectory) -> Callable[[TrainState], Row]:
    """The evaluation of all seeds' states, {metric: [S]}."""
    evaluate = make_evaluator(partial(evaluate_seed, networks), expert.mask.shape[0])
    return lambda states: jax.device_get(world.gathered(evaluate(states, expert, reference)))


def result_of(
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
