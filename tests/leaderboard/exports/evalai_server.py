"""A server that answers a host's worker as EvalAI's API does (its `apps/jobs/views.py`)."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs

TOKEN, QUEUE, CHALLENGE, PHASE = "a-token", "challenge-queue-7", 7, 3


@dataclass
class EvalAI:
    """A challenge's state."""

    split: str
    labels: list[str]
    url: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    submissions: dict[int, dict[str, Any]] = field(default_factory=dict)
    queue: list[dict[str, Any]] = field(default_factory=list)
    statuses: list[tuple[int, str]] = field(default_factory=list)
    told: dict[int, dict[str, str]] = field(default_factory=dict)
    leaderboard: dict[int, dict[str, float]] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)
    seen: list[tuple[str, str, str | None]] = field(default_factory=list)
    broken: int = 0

    def submit(self, name: str, content: bytes, challenge: int = CHALLENGE) -> int:
        number = len(self.submissions) + 1
        self.files[f"/media/{number}/{name}"] = content
        address = f"{self.url}/media/{number}/{name}"
        self.submissions[number] = {"id": number, "status": "submitted", "input_file": address}
        self.requeue(number, challenge)
        return number

    def requeue(self, number: int, challenge: int = CHALLENGE) -> None:
        body = {"submission_pk": number, "challenge_pk": challenge, "phase_pk": PHASE}
        self.queue.append({"body": body, "receipt_handle": f"handle-{number}"})

    def answer(self, method: str, path: str, fields: dict[str, str]) -> tuple[int, Any]:
        if path == f"/api/jobs/challenge/queues/{QUEUE}/" and method == "GET":
            # A message that was not deleted comes again.
            return 200, self.queue[0] if self.queue else {"body": None, "receipt_handle": None}
        if path.startswith("/api/jobs/submission/") and method == "GET":
            return 200, self.submissions[int(path.rsplit("/", 1)[1])]
        if path == f"/api/jobs/queues/{QUEUE}/" and method == "POST":
            kept = [m for m in self.queue if m["receipt_handle"] != fields["receipt_handle"]]
            self.queue[:] = kept
            return 200, {"success": "Message deleted successfully from the queue"}
        if path == f"/api/jobs/challenge/{CHALLENGE}/update_submission/":
            return self._patch(fields) if method == "PATCH" else self._put(fields)
        return 404, {"error": "no such place"}

    def _patch(self, fields: dict[str, str]) -> tuple[int, Any]:
        status = fields["submission_status"].lower()
        if status not in ("queued", "running"):
            return 400, {"error": "Sorry, submission status is invalid"}
        number = int(fields["submission"])
        self.submissions[number]["status"] = status
        self.statuses.append((number, status))
        return 200, self.submissions[number]

    def _put(self, fields: dict[str, str]) -> tuple[int, Any]:
        status, number = fields["submission_status"].lower(), int(fields["submission"])
        if status not in ("failed", "cancelled", "finished") or int(fields["challenge_phase"]) != 3:
            return 400, {"error": "Sorry, submission status is invalid"}
        if status == "finished":
            for entry in json.loads(fields["result"]):
                fault = self._fault(entry)
                if fault:
                    self.refused.append(fault)
                    return 400, {"error": fault}
                self.leaderboard[number] = entry["accuracies"]
        self.submissions[number]["status"] = status
        self.told[number] = fields
        return 200, {"success": "Submission result has been successfully updated"}

    def _fault(self, entry: dict[str, Any]) -> str | None:
        if entry["split"] != self.split:
            return "Challenge Phase Split does not exist"
        strange = [label for label in entry["accuracies"] if label not in self.labels]
        if strange:
            return f"Following metrics are missing in the leaderboard data: {strange}"
        lacking = set(self.labels) - set(entry["accuracies"])
        if lacking:
            return f"the leaderboard cannot be shown without {lacking}"
        if not all(isinstance(value, int | float) for value in entry["accuracies"].values()):
            return "Values for following metrics are not of float/int"
        return None


@contextmanager
def running_evalai(split: str, labels: list[str]) -> Iterator[EvalAI]:
    state = EvalAI(split, labels)

    class Handler(BaseHTTPRequestHandler):
        def _any(self) -> None:
            size = int(self.headers.get("Content-Length") or 0)
            given = parse_qs(self.rfile.read(size).decode(), keep_blank_values=True)
            token = self.headers.get("Authorization")
            state.seen.append((self.command, self.path, token))
            if self.path == "/moved":
                self.send_response(302)
                self.send_header("Location", f"{state.url}/elsewhere")
                return self.end_headers()
            if self.path in state.files:
                return self._send(200, state.files[self.path])
            if token != f"Bearer {TOKEN}":
                return self._send(401, b'{"error": "Invalid token"}')
            if state.broken:
                state.broken -= 1
                return self._send(502, b"<html>Bad gateway</html>")
            fields = {name: values[0] for name, values in given.items()}
            status, value = state.answer(self.command, self.path, fields)
            return self._send(status, json.dumps(value).encode())

        do_GET = do_POST = do_PUT = do_PATCH = _any  # noqa: N815 - names of the library

        def _send(self, status: int, content: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *given: object) -> None:
            del given

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        state.url = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield state
        server.shutdown()
        thread.join()
