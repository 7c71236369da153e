"""Page process of a run: `skinnet view` as a child process with lower priority."""

import contextlib
import subprocess
import sys
import threading
from collections.abc import Callable

__all__ = ["PageProcess"]

_EXIT_TIMEOUT_S = 5.0


class PageProcess:
    """Page process of a run, `skinnet view`.

    Args:
        print_line: Called with each line that it prints.
        keep: Keep the page after the end of the run.
        control: Show buttons for the controller's requests.
    """

    def __init__(
        self, print_line: Callable[[str], None], *, keep: bool = False, control: bool = False
    ) -> None:
        self._print_line, self._keep = print_line, keep
        self._options = [name for name, given in (("--keep", keep), ("--control", control)) if given]
        self._process: subprocess.Popen[str] | None = None
        self._reader: threading.Thread | None = None
        self._printed = self._run_ended = False

    def start(self, endpoint: str) -> None:
        """Start the page process on observer endpoint `endpoint`; its failure never affects the run."""
        command = [sys.executable, "-m", "skinnet.cli", "view", endpoint, *self._options]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._reader = threading.Thread(target=self._forward_output, name="viewer", daemon=True)
        self._reader.start()

    def __enter__(self) -> "PageProcess":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the page process after the run or, if it is kept, wait until the user ends it."""
        if self._process is None or self._reader is None:
            return
        self._run_ended = True
        stays = self._keep and kind is None and self._process.poll() is None
        if stays:
            self._print_line("the page is kept until Ctrl-C")
        # Ctrl-C on a kept page is no failure
        with contextlib.suppress(subprocess.TimeoutExpired, *((KeyboardInterrupt,) if stays else ())):
            self._process.wait(None if stays else _EXIT_TIMEOUT_S)
        self._process.terminate()
        self._process.wait()
        self._reader.join()
        if not self._printed:
            self._print_line("the run ended before its page was ready")

    def _forward_output(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                if self._printed or not self._run_ended:  # else it failed because the run had ended
                    self._printed = True
                    self._print_line(line.rstrip())
