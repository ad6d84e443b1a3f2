"""The wheel and its command: from any folder, one with an `envs` of its own too, and nothing of ours at the top."""

import importlib.util
import os
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from aircl_jax import console
from aircl_jax.console import COMMANDS, main

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("wheel_setup", ROOT / "setup.py")
assert SPEC is not None and SPEC.loader is not None
SETUP = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(SETUP)
SOURCES = sorted(path for package in ("aircl_jax", "envs", "experiments") for path in (ROOT / package).rglob("*.py"))
# What the extras bring and the core has to do without.
OF_EXTRAS = {
    *("pandas", "tigramite", "joblib", "pyarrow", "brax", "gymnasium", "minari", "h5py", "flatbuffers", "onnx", "onnxruntime"),
    *("tensorboardX", "wandb", "mlflow", "sphinx", "optuna"),
}
RUN = [
    *("run", "env=gridworld", "method=airl", "scale=smoke", "iterations=2", "run_dir=out", "seeds=1"),
    *("env.size=3", "env.goal=[2,2]", "env.obstacles=[[1,1]]", "env.horizon=4", "train.hidden=[4]"),
]


@pytest.mark.parametrize(
    ("text", "within"),
    [
        ("from envs import Env\n", "from aircl_jax.envs import Env\n"),
        ("    from experiments.cli.words import parse\n", "    from aircl_jax.experiments.cli.words import parse\n"),
        ("from brax import envs\n", "from brax import envs\n"),
        ('resources.files("envs") / "x"', 'resources.files("aircl_jax.envs") / "x"'),
        ('"envs.gridworld:make_gridworld"', '"aircl_jax.envs.gridworld:make_gridworld"'),
        ('config_path="pkg://experiments.cli.conf"', 'config_path="pkg://aircl_jax.experiments.cli.conf"'),
        ('["python", "-m", "experiments.swap", *words]', '["aircl", "swap", *words]'),
        ('[sys.executable, "-m", "experiments.run"]', '[sys.executable, "-m", "aircl_jax.experiments.run"]'),
        ("run `python -m experiments.run env=x`", "run `aircl run env=x`"),
        ("the envs of an experiment", "the envs of an experiment"),
    ],
)
def test_what_names_a_moved_package_is_rewritten_once(text, within):
    assert SETUP.rewritten(text) == within
    assert SETUP.rewritten(within) == within


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_is_python_after_it_and_imports_nothing_from_the_top(path):
    text = SETUP.rewritten(path.read_text(encoding="utf-8"))
    compile(text, str(path), "exec")
    assert not any(line.lstrip().startswith(("from envs", "import envs", "from experiments")) for line in text.splitlines())


def test_every_command_is_one_of_experiments_and_every_one_of_them_has_its_word():
    folder = ROOT / "experiments"
    commands = {path.stem for path in folder.glob("*.py") if path.stem != "__init__"}
    commands |= {path.parent.name for path in folder.glob("*/__main__.py")}
    assert set(COMMANDS) == commands


def test_words_go_to_the_command_and_its_code_comes_back(monkeypatch, capsys):
    told: list[list[str]] = []
    real = console.importlib.import_module
    fake = SimpleNamespace(main=lambda words: told.append(words) or 7)
    monkeypatch.setattr(
        console.importlib, "import_module", lambda name: fake if name == "experiments.shield.__main__" else real(name)
    )
    assert main(["shield", "run_dir=x", "--help"]) == 7
    assert told == [["run_dir=x", "--help"]]
    assert main([]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {name} " in shown for name in COMMANDS)


def test_a_command_whose_extra_is_missing_is_one_line(monkeypatch, capsys):
    def absent(name):
        if name == "experiments.figure4.__main__":
            raise ImportError("causal links need the package tigramite, which is not installed; install aircl-jax[animals]")
        return SimpleNamespace()

    monkeypatch.setattr(console.importlib, "import_module", absent)
    assert main(["figure4"]) == 2
    assert capsys.readouterr().err.rstrip().endswith("install aircl-jax[animals]")


def test_an_unknown_command_is_one_line(capsys):
    assert main(["runn"]) == 2
    assert capsys.readouterr().err.startswith("error: unknown command 'runn'; choose from run, search")


def test_the_script_and_the_files_beside_the_code_are_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["scripts"] == {"aircl": "aircl_jax.console:main"}
    declared = project["tool"]["setuptools"]["package-data"]
    beside = {path.name for path in (ROOT / "aircl_jax").rglob("*.html")}
    assert {Path(name).name for name in declared["aircl_jax"]} >= beside


BLOCKING = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {NAMES!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""


@pytest.mark.slow
def test_a_wheel_without_any_extra_runs_from_a_folder_that_has_envs_and_experiments_of_its_own(tmp_path):
    sources, built, own, absent = (tmp_path / name for name in ("sources", "built", "own", "absent"))
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files", "-z"], capture_output=True, check=True).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("results/", "notebooks/", "tests/", "docs/")):
            (sources / name).parent.mkdir(parents=True, exist_ok=True)
            (sources / name).write_bytes((ROOT / name).read_bytes())
    words = ("wheel", ".", "--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--wheel-dir", str(built))
    subprocess.run([sys.executable, "-m", "pip", *words], cwd=sources, check=True, timeout=600)
    [wheel] = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        tops = {name.split("/")[0] for name in file.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"aircl_jax"}

    venv.create(tmp_path / "empty", with_pip=False)
    python = tmp_path / "empty" / "bin" / "python"
    install = ("--python", str(python), "install", "--no-index", "--no-deps", "--quiet", str(wheel))
    subprocess.run([sys.executable, "-m", "pip", *install], check=True, timeout=600)
    [packages] = (tmp_path / "empty" / "lib").glob("python*/site-packages")
    (packages / "dependencies.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    absent.mkdir()
    (absent / "sitecustomize.py").write_text(BLOCKING.format(NAMES=OF_EXTRAS))
    for name in ("envs", "experiments"):
        (own / name).mkdir(parents=True)
        (own / name / "__init__.py").write_text("raise RuntimeError('this is not yours')", encoding="utf-8")

    def aircl(*words: str) -> subprocess.CompletedProcess[str]:
        command = [str(python.with_name("aircl")), *words]
        environment = {**os.environ, "PYTHONPATH": str(absent)}
        return subprocess.run(command, cwd=own, env=environment, capture_output=True, text=True, check=False, timeout=600)

    told = aircl("run", "--help")
    assert told.returncode == 0 and "env=gridworld" in told.stdout, told.stderr
    ended = aircl(*RUN)
    assert ended.returncode == 0, ended.stderr
    assert "aircl run env=gridworld" in ended.stdout and "python -m" not in ended.stdout
    assert "aircl run env=gridworld" in (own / "out" / "report.md").read_text(encoding="utf-8")
    assert (own / "out" / "report.html").exists()
    for words, extra in (
        (("export", "run_dir=out"), "export"),
        (("figure4",), "animals"),
        (("minari", "minari=a-v0"), "minari"),
        (("search", "train.ppo.learning_rate=0.001:0.01"), "search"),
    ):
        refused = aircl(*words)
        assert refused.returncode == 2 and refused.stderr.count("\n") == 1, refused.stderr
        assert refused.stderr.rstrip().endswith(f"install aircl-jax[{extra}]")
