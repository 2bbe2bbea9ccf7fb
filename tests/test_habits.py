"""Checks of the repository itself: workflows, hooks, and the one script that runs everything."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_are_of_the_hosts_schema(path):
    """For a misspelt key the host reports no error, but the job never runs."""
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.github-workflows", path]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_workflows_run_the_script_and_the_slow_lane():
    texts = {path.name: path.read_text(encoding="utf-8") for path in WORKFLOWS}
    assert set(texts) == {"ci.yml", "nightly.yml"}
    assert "- run: .ci/run" in texts["ci.yml"] and "pytest -m slow" in texts["nightly.yml"]
    assert {"push:", "pull_request:"} <= set(texts["ci.yml"].split()) and "cron:" in texts["nightly.yml"]
    used = re.findall(r"uses: (\S+)", "".join(texts.values()))
    # only a commit's hash, because a tag can be moved to another commit
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", action) for action in used)


def test_script_and_hooks_run_the_same_checks():
    """Hooks need no network: they are local and run programs that the extras install."""
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    checks = ("ruff check", "ruff format", "pyright")
    for check in checks:
        assert re.search(rf"^{check}\b", script, re.MULTILINE)
        assert re.search(rf"^ +entry: {check}\b", hooks, re.MULTILINE)
    assert re.findall(r"repo: (\S+)", hooks) == ["local"]
    assert hooks.count("language: system") == hooks.count("- id:") == len(checks)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    named = {re.match(r"[\w-]+", one)[0] for one in extras["test"] + extras["dev"]}
    assert {"ruff", "pyright", "check-jsonschema", "pre-commit"} <= named
