from dataclasses import FrozenInstanceError, replace

import pytest

from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.methods import METHODS, get_method

PAPER = ["airl", "gacl", "icrl", "icrl_prior", "aircl", "aircl_no_prior", "aircl_linear", "aircl_sa"]
OURS = [
    "airl_centred",
    "aircl_corrected",
    "aircl_corrected_prior",
    "aircl_corrected_linear",
    "aircl_corrected_sa",
    "aircl_contrast",
    "aircl_contrast_memory",
    "behaviour",
    "airl_tuned",
    "gacl_tuned",
    "icrl_tuned",
    "bc",
]
# What a term reads: without it the term would be a constant.
NEEDS = {
    "feasibility_gradient": "",
    "minimal": "",
    "step_ratio": "step",
    "sequence_ratio": "sequence",
    "entry_ratio": "step",
    "gacl": "step",
    "icrl": "step",
}


def test_the_table_holds_the_papers_eight_rows_and_ours():
    assert sorted(METHODS) == sorted(PAPER + OURS)


@pytest.mark.parametrize("name", METHODS)
def test_every_term_of_a_row_has_an_equation_and_the_network_that_it_trains(name):
    row = METHODS[name]
    assert set(row.terms) <= set(TERMS)
    for term in set(row.terms) & set(NEEDS):
        assert row.feasibility != "none"
        assert NEEDS[term] in row.feasibility


def test_every_term_is_used_by_a_row():
    assert {term for row in METHODS.values() for term in row.terms} == set(TERMS)


@pytest.mark.parametrize(
    ("ablation", "full", "changes"),
    [
        ("aircl_no_prior", "aircl", {"terms": ("discriminator", "feasibility_gradient", "minimal")}),
        ("aircl_linear", "aircl", {"network": "linear"}),
        ("aircl_sa", "aircl", {"feasibility": "step"}),
        ("icrl_prior", "icrl", {"terms": ("icrl", "contrast")}),
        ("aircl_corrected_linear", "aircl_corrected", {"network": "linear"}),
    ],
)
def test_an_ablation_differs_from_its_row_in_one_thing(ablation, full, changes):
    assert METHODS[ablation] == replace(METHODS[full], **changes)


def test_only_gacl_and_icrl_know_the_true_reward():
    assert {name for name, row in METHODS.items() if row.needs_true_reward} == {
        *("gacl", "icrl", "icrl_prior", "gacl_tuned", "icrl_tuned"),
    }


@pytest.mark.parametrize("name", PAPER)
def test_log_feasibility_enters_the_policy_reward_only_where_the_paper_says_so(name):
    assert METHODS[name].constrained_policy == (name in {"gacl", "icrl", "icrl_prior"})


@pytest.mark.parametrize(
    ("name", "switch", "present"),
    [
        ("aircl", "off", False),
        ("icrl", "on", True),
        ("gacl", "on", True),
        ("icrl_tuned", "on", True),
        ("gacl_tuned", "on", True),
    ],
)
def test_contrast_prior_can_be_switched_on_any_row_with_a_feasibility(name, switch, present):
    row = get_method(name, switch)
    assert ("contrast" in row.terms) == present
    assert row.terms.count("contrast") <= 1
    assert [one for one in row.terms if one != "contrast"] == [one for one in METHODS[name].terms if one != "contrast"]


@pytest.mark.parametrize("name", ["airl", "airl_tuned"])
def test_contrast_prior_is_refused_where_there_is_no_feasibility(name):
    with pytest.raises(ValueError, match=f"{name} has no feasibility"):
        get_method(name, "on")


def test_unknown_method_is_named_with_the_choices():
    with pytest.raises(ValueError, match=r"unknown method 'gail'; choose from airl, .*aircl_corrected"):
        get_method("gail")


def test_rows_are_frozen():
    with pytest.raises(FrozenInstanceError):
        METHODS["airl"].network = "linear"  # pyright: ignore[reportAttributeAccessIssue]
