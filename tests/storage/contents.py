"""Contents that replace each other at a URL."""

from __future__ import annotations

from collections.abc import Callable

from tests.storage.conftest import Bucket

GOOD = bytes(range(256)) * 40
BAD = GOOD[::-1]
Put = Callable[[bytes], None]


def putting(bucket: Bucket, key: str) -> Put:
    return lambda content: bucket.client.put_object(Bucket=bucket.name, Key=key, Body=content)
