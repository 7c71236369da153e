"""Plain Zenoh clients of a run."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zenoh


@contextmanager
def client(endpoint: str) -> Iterator[Any]:
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [endpoint]),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


def endpoint_of(line: str) -> str:
    return line.split("connect to ")[1].split(",")[0]
