"""Parameters of memories of earlier versions, translated to their present names."""

from collections.abc import Mapping

from skinnet.migration.format_1 import PARAMETERS
from skinnet.migration.renaming import rename_keys

__all__ = ["VERSION", "current_parameter", "translate_parameters"]

VERSION = 2
"""Version of memories, in SQLite and in JSON; version 1 has other names of parameters."""


def current_parameter(name: str) -> str:
    """Present name of a parameter of version 1, such as `release.timeout_s`; only its last part differs."""
    head, dot, last = name.rpartition(".")
    return f"{head}{dot}{PARAMETERS.get(last, last)}"


def translate_parameters(parameters: Mapping[str, float]) -> tuple[dict[str, float], int]:
    """Translate the parameters of a memory of version 1; return them and the number of new names.

    Raises:
        FormatError: an old name stands beside its new one.
    """
    return (
        rename_keys(parameters, current_parameter, "parameters"),
        sum(current_parameter(name) != name for name in parameters),
    )
