"""Request buttons of the controller."""

import html

import viser

from skinnet.view.sources.live_source import LiveSource
from skinnet.view.state.run_state import RunState

__all__ = ["RequestButtons"]


class RequestButtons:
    """Request buttons, one for each request or each of its arguments; none without a source.

    Args:
        gui: Parent of the buttons.
        source: Live source that sends the requests; None for no buttons.
    """

    def __init__(self, gui: viser.GuiApi, source: LiveSource | None) -> None:
        self._gui, self._source = gui, source
        self._requests: dict[str, list[str]] | None = None
        self._folder: viser.GuiFolderHandle | None = None

    def update(self, scene: RunState) -> None:
        """Update the buttons to the requests that the controller accepts."""
        machine = scene.controller.description
        if self._source is None or (machine is None and self._folder is not None):
            return
        offered = machine.requests if machine is not None else {}
        if offered == self._requests:
            return
        self._requests = dict(offered)
        if self._folder is not None:
            self._folder.remove()
        self._folder = self._gui.add_folder("Requests")
        with self._folder:
            for what, arguments in offered.items():
                self._add(what, arguments)
            self._status_line = self._gui.add_html(
                _status_html("" if offered else "the controller accepts no requests")
            )

    def _add(self, what: str, arguments: list[str]) -> None:
        if arguments == [""]:
            button = self._gui.add_button(what)
            button.on_click(lambda _: self._send(what, ""))
        elif arguments:
            group = self._gui.add_button_group(what, arguments)
            group.on_click(lambda event: self._send(what, event.target.value))
        else:
            text = self._gui.add_text(what, "")
            button = self._gui.add_button(f"{what} it")
            button.on_click(lambda _: self._send(what, text.value))

    def _send(self, what: str, argument: str) -> None:
        """Send a request and wait for its answer, in a thread of viser."""
        assert self._source is not None
        self._status_line.content = _status_html(f"{what} {argument} …")
        answer = self._source.request(what, argument)
        self._status_line.content = _status_html(f"{what} {argument}: {answer}")


def _status_html(text: str) -> str:
    return f'<div style="padding:2px 10px;font-size:12px;color:#1f2d3d">{html.escape(text)}</div>'
