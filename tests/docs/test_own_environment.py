"""The guide's own world, run as a reader runs it: without any setting."""

import pytest

from aircl_jax import train
from aircl_jax.reports.alarms import alarms
from tests.worlds import guides_world

KNOWN = "the discriminator still tells π from the expert"  # the one alarm that still rings there (docs/research.md)


@pytest.mark.slow
def test_the_guides_world_needs_no_setting(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    summary = train(guides_world(), seeds=3, first_seed=100).summary
    metrics = {name: values["per_seed"] for name, values in summary["metrics"].items()}
    assert max(metrics["violation_rate_policy"]) <= 0.01
    assert min(metrics["feasibility_auroc"]) >= 0.95
    assert min(metrics["feasibility_policy"]) >= 0.6
    assert min(metrics["return"]) >= 0.95 * metrics["expert_return"][0]
    rung = alarms(summary["seeds"], {name: {"per_seed": values} for name, values in metrics.items()})
    assert [sentence for sentence in rung if not sentence.startswith(KNOWN)] == []
