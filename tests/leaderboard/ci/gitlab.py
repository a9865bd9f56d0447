"""A GitLab for tests: jobs of .gitlab-ci.yml in their stages, each in a fresh clone, and an API.

Of GitLab's rules it has what the template uses, as docs.gitlab.com describes them: `extends`,
`rules` of conditions joined by &&, variables of a project (protected, and of one environment),
artifacts of earlier stages, dotenv reports, and jobs that are left out after a failure.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import parse_qs

import pytest

from tests.leaderboard.ci.repositories import git

yaml = pytest.importorskip("yaml")

PATH, TOKEN, KEY = "lab/vision/board", "glpat-of-the-project", "AGE-SECRET-KEY-1"
PROJECT = "/api/v4/projects/42"
SECRETS = {"LEADERBOARD_TOKEN": (TOKEN, "leaderboard"), "AIRZOO_BENCH_KEY": (KEY, "sealed")}
_NOT_JOBS = {"stages", "workflow", "default", "variables"}
_REPOSITORY = Path(__file__).resolve().parents[3]


@dataclass
class Ran:
    """A job that was run: how it ended, what it printed, and what it was given."""

    code: int
    log: str
    variables: Mapping[str, str]


@dataclass
class Api:
    """What the API answers, by path, and what was sent to it."""

    answers: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    url: str = ""


@contextmanager
def running_api() -> Iterator[Api]:
    api = Api()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            known = self.headers["PRIVATE-TOKEN"] == TOKEN and self.path in api.answers
            self._answer(200 if known else 404, api.answers.get(self.path) if known else None)

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"])).decode()
            known = self.headers["PRIVATE-TOKEN"] == TOKEN and self.path.endswith("/notes")
            if known:
                api.notes.append(parse_qs(body)["body"][0])
            self._answer(201 if known else 404, {})

        def _answer(self, status: int, content: Any) -> None:
            self.send_response(status)
            self.end_headers()
            self.wfile.write(json.dumps(content).encode())

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        api.url = f"http://127.0.0.1:{server.server_port}"
        Thread(target=server.serve_forever, daemon=True).start()
        yield api
        server.shutdown()


@dataclass
class Project:
    """A project, or a fork of it, which has no variables of its own."""

    hosted: Path
    home: Path
    api: Api
    path: str = PATH
    pipelines: int = 0

    def pipeline(self, source: str = "push", **given: str) -> dict[str, Ran]:
        """Run what GitLab would of the default branch, and return the jobs by name."""
        self.pipelines += 1
        home = self.home / self.path / str(self.pipelines)
        return Pipeline(self, self.config(), home, source, given).run()

    def config(self) -> dict[str, Any]:
        found = yaml.safe_load(git(self.hosted, "show", "main:.gitlab-ci.yml"))
        assert isinstance(found, dict)
        return found


@dataclass
class Pipeline:
    """A pipeline, stage by stage."""

    project: Project
    config: dict[str, Any]
    home: Path
    source: str
    given: Mapping[str, str]
    ran: dict[str, Ran] = field(default_factory=dict)
    dotenv: dict[str, str] = field(default_factory=dict)

    def run(self) -> dict[str, Ran]:
        variables = self.variables({}, "")
        if not _matching(self.config["workflow"]["rules"], variables):
            return {}
        failed = False
        for stage in self.config["stages"]:
            before = failed
            for name, job in self.jobs(stage):
                rules = _matching(job["rules"], variables)
                alone = job.get("needs") == []
                if rules and (alone or not before or rules[0].get("when") == "always"):
                    self.ran[name] = self._run(name, job, alone)
                    failed |= self.ran[name].code != 0
        return self.ran

    def jobs(self, stage: str) -> list[tuple[str, dict[str, Any]]]:
        names = [name for name in self.config if name not in _NOT_JOBS and name[0] != "."]
        jobs = [(name, self._extended(name)) for name in names]
        return [(name, job) for name, job in jobs if job["stage"] == stage]

    def _extended(self, name: str) -> dict[str, Any]:
        job = dict(self.config[name])
        bases = job.pop("extends", [])
        for base in [bases] if isinstance(bases, str) else bases:
            job = {**self._extended(base), **job}
        return {"before_script": self.config["default"]["before_script"], **job}

    def variables(self, job: Mapping[str, Any], folder: str) -> dict[str, str]:
        environment = job.get("environment", {}).get("name")
        own = self.project.path == PATH
        found = {
            "CI_API_V4_URL": f"{self.project.api.url}/api/v4", "CI_PROJECT_ID": "42",
            "CI_PROJECT_PATH": self.project.path, "CI_DEFAULT_BRANCH": "main",
            "CI_PROJECT_URL": f"file://{self.project.hosted.with_suffix('')}",
            "CI_PIPELINE_SOURCE": self.source, "CI_JOB_TOKEN": "of-the-job",
            "CI_COMMIT_SHA": git(self.project.hosted, "rev-parse", "main"),
            "CI_PROJECT_DIR": folder,
        }  # fmt: skip
        if self.source != "merge_request_event":
            found["CI_COMMIT_BRANCH"] = "main"
        found |= self.dotenv
        stated = {**self.config["variables"], **job.get("variables", {})}
        found |= {key: text for key, (text, of) in SECRETS.items() if own and of == environment}
        found |= self.given
        return found | {key: _expanded(text, found) for key, text in stated.items()}

    def _run(self, name: str, job: dict[str, Any], alone: bool) -> Ran:
        folder = self.home / name
        clone = ("clone", "--quiet", "--depth=1", f"file://{self.project.hosted}", str(folder))
        self.home.mkdir(parents=True, exist_ok=True)
        git(self.home, *clone)
        kept = self.home / "artifacts"
        if kept.exists() and not alone:
            shutil.copytree(kept, folder, dirs_exist_ok=True)
        variables = self.variables(job, str(folder))
        done = subprocess.run(
            ["bash", "-eo", "pipefail", "-c", "\n".join([*job["before_script"], *job["script"]])],
            cwd=folder, env=variables | self._of_machine(), stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip
        self._keep(job.get("artifacts", {}), folder, kept, done.returncode)
        return Ran(done.returncode, done.stdout, variables)

    def _of_machine(self) -> dict[str, str]:
        """Return an environment where this checkout is installed, and pip has nothing to do."""
        programs = self.home / "programs"
        programs.mkdir(exist_ok=True)
        run = f'PYTHONPATH={_REPOSITORY} exec {sys.executable} -m airzoo_bench "$@"'
        for program, line in (("airzoo-bench", run), ("python", 'test "$2" = pip')):
            (programs / program).write_text(f"#!/bin/sh\n{line}\n")
            (programs / program).chmod(0o755)
        kept = {key: os.environ[key] for key in ("HOME", "AIRZOO_BENCH_DATA")}
        return kept | {"PATH": f"{programs}:{os.environ['PATH']}"}

    def _keep(self, artifacts: dict[str, Any], folder: Path, kept: Path, code: int) -> None:
        if code == 0 or artifacts.get("when") == "always":
            for path in artifacts.get("paths", []):
                if (folder / path).is_dir():
                    shutil.copytree(folder / path, kept / path, dirs_exist_ok=True)
                elif (folder / path).exists():
                    kept.mkdir(exist_ok=True)
                    shutil.copy(folder / path, kept / path)
        report = folder / artifacts.get("reports", {}).get("dotenv", "none")
        if report.is_file():
            lines = report.read_text().splitlines()
            self.dotenv |= dict(line.split("=", 1) for line in lines)


def _expanded(text: str, variables: Mapping[str, str]) -> str:
    return re.sub(r"\$([A-Z_0-9]+)", lambda found: variables.get(found[1], ""), text)


def _matching(rules: list[dict[str, str]], variables: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the rules that hold; a job runs where there is one, as the first says."""
    return [
        rule for rule in rules if all(_holds(part, variables) for part in rule["if"].split(" && "))
    ]


def _holds(condition: str, variables: Mapping[str, str]) -> bool:
    left, operator, right = condition.split(" ", 2)
    value = variables.get(left.removeprefix("$"))
    if operator == "=~":
        return value is not None and re.search(right.strip("/"), value) is not None
    assert operator == "=="
    wanted = variables.get(right[1:]) if right[0] == "$" else json.loads(right)
    return value == wanted
