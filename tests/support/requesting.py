"""Requests to a run, by the command line."""

from launching import skinnet


def request(*arguments: str) -> tuple[int, str]:
    """Exit code and the one line that `skinnet request` prints."""
    done = skinnet("request", *arguments, "--timeout", "60")
    (said,) = (done.stdout + done.stderr).splitlines()
    return done.returncode, said
