"""The guide's own world, run as a reader runs it: without any setting."""

import re
from pathlib import Path
from typing import Any

import pytest

from aircl_jax import train
from aircl_jax.reports.alarms import alarms

GUIDE = Path(__file__).parents[2] / "docs" / "guide.md"
KNOWN = "the discriminator still tells π from the expert"  # the one alarm that still rings there (docs/research.md)


def world() -> Any:
    """The point that goes round a disc, with demonstrations and a reference set, as the guide writes them."""
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```$", GUIDE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL):
        if any(begin in block for begin in ("point = Env(", "def record(", "scored = replace(")):
            exec(compile(block, str(GUIDE), "exec"), names)
    return names["scored"]


@pytest.mark.slow
def test_the_guides_world_needs_no_setting(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    summary = train(world(), seeds=3, first_seed=100).summary
    metrics = {name: values["per_seed"] for name, values in summary["metrics"].items()}
    assert max(metrics["violation_rate_policy"]) <= 0.01
    assert min(metrics["feasibility_auroc"]) >= 0.95
    assert min(metrics["feasibility_policy"]) >= 0.6
    assert min(metrics["return"]) >= 0.95 * metrics["expert_return"][0]
    rung = alarms(summary["seeds"], {name: {"per_seed": values} for name, values in metrics.items()})
    assert [sentence for sentence in rung if not sentence.startswith(KNOWN)] == []
