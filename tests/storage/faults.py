"""What storage answers when it refuses or breaks off."""

from __future__ import annotations

from collections.abc import Callable

from tests.storage.servers import Answer, Asked

CONTENT = bytes(range(256)) * 40


def s3_refusal(status: int, code: str) -> Answer:
    body = f"<Error><Code>{code}</Code><Message>{code}</Message></Error>".encode()
    return Answer(status, {"Content-Type": "application/xml"}, body)


def always(answer: Answer, method: str | None = None) -> Callable[[Asked, Answer], Answer]:
    return lambda asked, real: answer if method in (None, asked.method) else real
