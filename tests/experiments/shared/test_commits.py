"""The commit that a number is said to be of, and whether the code has changed since, in a repository made for it."""

import subprocess
from pathlib import Path

import pytest

from experiments.shared import commits


@pytest.fixture
def repository(tmp_path, monkeypatch) -> Path:
    """Its library's folders, its experiments and its pages, in one commit."""
    for folder in ("aircl_jax", "envs", "experiments", "docs"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "file.py").write_text("1\n")
    (tmp_path / "pyproject.toml").write_text("\n")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "-c", "user.name=a", "-c", "user.email=a@b.c", "commit", "--quiet", "-m", "first")
    monkeypatch.setattr(commits, "ROOT", tmp_path)
    return tmp_path


def git(folder: Path, *words: str) -> None:
    subprocess.run(["git", "-C", str(folder), *words], check=True)


@pytest.mark.parametrize(
    ("folder", "dirty", "changed"),
    [("aircl_jax", True, True), ("envs", True, True), ("experiments", True, False), ("docs", False, False)],
)
def test_the_library_has_changed_where_a_number_could_have(folder, dirty, changed, repository):
    first = commits.current_commit()
    assert len(first) >= 7 and not first.endswith("-dirty")
    assert commits.changed_since(first) is False
    (repository / folder / "file.py").write_text("2\n")
    assert commits.current_commit() == first + ("-dirty" if dirty else "")
    assert commits.changed_since(first) is changed


def test_code_of_an_unknown_commit_cannot_be_compared():
    assert commits.changed_since("0000000") is None
    assert commits.changed_since("abc1234-dirty") is None
