"""Read from the kept results how far methods predict held-out recordings of the meerkats better than a first-order chain."""

import json
from pathlib import Path

import numpy as np
from scipy import stats

RESULTS = Path(__file__).parents[2] / "results"
FOLDS = "figure4/recorded/held_out"
STUDY = "behaviour/meerkat/numbers.json"


def gains_over_the_chain(method: str, results: Path = RESULTS) -> tuple[str, ...]:
    """Say both gains on the published recordings, this method's and the behaviour model's; nothing where none is kept."""
    cells = [json.loads(path.read_text(encoding="utf-8")) for path in sorted((results / FOLDS).glob(f"{method}_[0-9]*.json"))]
    study = results / STUDY
    if len(cells) < 2 or not study.is_file():
        return ()
    own = np.array([cell["policy"] - cell["chain"] for cell in cells])
    half = float(stats.t.ppf(0.975, len(own) - 1) * own.std(ddof=1) / len(own) ** 0.5)
    model = json.loads(study.read_text(encoding="utf-8"))["comparisons"]["windows"]["per_step"]
    line = (
        f"On held-out pairs of the published recordings, {len(own)} folds, gains over a first-order chain in nats a step: "
        f"{method} {_gain(own.mean(), own.mean() - half, own.mean() + half)} (results/{FOLDS}); the behaviour model "
        f"{_gain(model['mean'], model['low'], model['high'])} (`python -m experiments.behaviour`, results/behaviour.md)."
    )
    return (line,)


def _gain(mean: float, low: float, high: float) -> str:
    return f"{mean:+.4f} [{low:+.4f}, {high:+.4f}]"
