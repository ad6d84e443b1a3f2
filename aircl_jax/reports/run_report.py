"""Write report.md of a finished run, and the text that the command line ends with, from its summary."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aircl_jax.reports import markdown
from aircl_jax.reports.summary import meaning
from aircl_jax.runs.directory import FIGURES, REPORT
from aircl_jax.settings.env_defaults import GUESTS
from envs import ENVS


def table(summary: Mapping[str, Any]) -> str:
    """Write the metrics as Markdown: mean ± standard deviation, and what the name means."""
    rows = []
    for name, row in _defined(summary).items():
        spread = "" if row["std"] is None else f" ± {_short(row['std'])}"
        of = f" (of {row['of']} seeds)" if "of" in row else ""
        rows.append((name, _short(row["mean"]) + spread + of, meaning(name)))
    return markdown.table(("metric", "mean ± std", "what"), rows, aligned=True)


def seed_table(summary: Mapping[str, Any]) -> str:
    """Write every seed's metrics as Markdown."""
    rows = [(name, *map(_short, row["per_seed"])) for name, row in _defined(summary).items()]
    return markdown.table(("metric", *(f"seed {seed}" for seed in summary["seeds"])), rows, aligned=True)


def report(
    summary: Mapping[str, Any],
    alarms: Sequence[str],
    figures: Sequence[tuple[Path, str]],
    command: str,
    reading: str = "",
    account: Sequence[str] = (),
) -> str:
    """Write report.md: command, alarms, the tables read, figures, plain words, measures, every seed, and what to try next."""
    return markdown.paragraphs(
        f"# {summary['method']} on {summary['env']}",
        f"`{command}`" if command else "Trained from Python.",
        _effort(summary),
        "## Alarms",
        markdown.bullets(map(_sentence, alarms)) or "None rang.",
        *(["## What was read", markdown.bullets(map(_sentence, account))] if account else []),
        "## Figures",
        *(f"![{path.stem}]({FIGURES}/{path.name})\n\n{caption}" for path, caption in figures),
        *(["## In plain words", reading] if reading else []),
        "## Measures at the end",
        table(summary),
        _undefined(summary),
        "## Every seed",
        seed_table(summary),
        "## What to try next",
        markdown.bullets(f"{_sentence(purpose)}: `{line}`" for line, purpose in suggestions(summary)),
    )


def _defined(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Select the metrics that at least one seed has."""
    return {name: row for name, row in summary["metrics"].items() if any(value is not None for value in row["per_seed"])}


def _undefined(summary: Mapping[str, Any]) -> str:
    missing = [name for name in summary["metrics"] if name not in _defined(summary)]
    return f"Undefined here: {', '.join(missing)}." if missing else "Every measure is defined here."


def closing(summary: Mapping[str, Any], alarms: Sequence[str], run_dir: str) -> str:
    """Write the text that the command line ends with."""
    return markdown.paragraphs(
        "",
        table(summary),
        _undefined(summary),
        _effort(summary),
        "Alarms:\n" + markdown.bullets(alarms) if alarms else "No alarm rang.",
        f"Every seed: {run_dir}/{REPORT}   figures: {run_dir}/{FIGURES}/",
        "What to try next:\n" + "\n".join(f"  {line}   # {purpose}" for line, purpose in suggestions(summary)),
    )


def suggestions(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List commands to try after a run, each with its purpose."""
    (env, _, of), method = summary["env"].partition(" "), summary["method"]
    baseline = "airl_centred" if method != "airl_centred" else "aircl_corrected"
    if env not in ENVS:  # an environment passed from Python, which the command line does not know
        return [(f'train(env, "{baseline}")', "without a constraint, or with one: what the feasibility adds")]
    run = f"python -m experiments.run env={env}" + (f" env.task={of}" if env in GUESTS else "")
    return [
        (f"{run} method={baseline}", "without a constraint, or with one: what the feasibility adds"),
        (f"{run} method={method} first_seed=100 run_dir=runs/{env}/{method}_from_100", "other seeds"),
        (f"{run} method={method} demonstrations=FILE.npz run_dir=runs/{env}/mine", "your own demonstrations"),
        (f"{run} --help", "every setting"),
    ]


def _effort(summary: Mapping[str, Any]) -> str:
    seeds, speed = len(summary["seeds"]), summary["env_steps_per_s"]
    return (
        f"{summary['iterations']} iterations, {seeds} seed{'s' if seeds > 1 else ''}, {summary['env_steps']:,} env "
        f"steps in {summary['wall_s']:.0f} s, {summary['compile_s']:.0f} s of it compiling"
        + (f"; {speed:,.0f} env steps/s." if speed else ".")
    )


def _short(value: float | None) -> str:
    return "null" if value is None else f"{value:.3g}"


def _sentence(text: str) -> str:
    """Begin the text with a capital letter, unless it begins with a symbol such as δ̄."""
    return text[0].upper() + text[1:] if text[0].isascii() else text
