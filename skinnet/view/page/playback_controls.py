"""Playback controls of a recording: time slider, pause, rate and loop."""

from collections.abc import Callable

import viser

from skinnet.view.sources.recording_source import RecordingSource

__all__ = ["PlaybackControls"]

_RATES = ("0.1", "0.25", "0.5", "1", "2", "5", "10", "50")
_PERIOD_S = 0.2
_USER_HOLD_S = 0.6
"""Time [s] after a user's change in which the slider is not updated."""


class PlaybackControls:
    """Playback controls; none without a recording.

    A user's change and the page's own updates of the slider both run in the event loop of the page's server:
    an update between a change and its callback would pass for the change, which would be lost.

    Args:
        gui: Parent of the controls.
        call_in_event_loop: Calls a function in the event loop of the page's server; thread-safe.
        source: Source that plays the recording, or None.
        enqueue_action: Queues an action for the page's update loop, which calls it with the wall time [s].
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        call_in_event_loop: Callable[..., object],
        source: RecordingSource | None,
        enqueue_action: Callable[[Callable[[float], None]], None],
    ) -> None:
        self._source, self._call_in_event_loop = source, call_in_event_loop
        self._due_s = 0.0
        if source is None:
            return
        playback, self._enqueue_action = source.clock, enqueue_action
        with gui.add_folder("Recording"):
            start_s, end_s = playback.start_ns * 1e-9, playback.end_ns * 1e-9
            self._slider = gui.add_slider(
                "Time [s]", min=start_s, max=max(end_s, start_s + 0.01), step=0.01, initial_value=start_s
            )
            self._button = gui.add_button("Pause")
            rate = gui.add_dropdown("Rate", _RATES, initial_value="1")
            loop = gui.add_checkbox("Loop", playback.loop)
        self._slider.on_update(self._on_slider)
        self._button.on_click(lambda _: enqueue_action(self._toggle))
        rate.on_update(
            lambda event: enqueue_action(lambda now_s: playback.set_rate(float(event.target.value), now_s))
        )
        loop.on_update(lambda event: enqueue_action(lambda _: setattr(playback, "loop", event.target.value)))

    def update(self, now_s: float) -> None:
        """Update slider and button."""
        if self._source is None or now_s < self._due_s:
            return
        self._due_s = now_s + _PERIOD_S
        playback = self._source.clock
        self._call_in_event_loop(self._show, round(playback.position_ns(now_s) * 1e-9, 2))
        self._button.label = "Pause" if playback.playing else "Play"

    def _show(self, position_s: float) -> None:
        self._slider.value = position_s  # type: ignore[misc]

    async def _on_slider(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client is None or self._source is None:
            return  # moved by this program
        playback, t_ns = self._source.clock, round(event.target.value * 1e9)

        def go(now_s: float) -> None:
            playback.seek(t_ns, now_s)
            self._due_s = now_s + _USER_HOLD_S

        self._enqueue_action(go)

    def _toggle(self, now_s: float) -> None:
        assert self._source is not None
        playback = self._source.clock
        if playback.playing:
            playback.pause(now_s)
        else:
            playback.play(now_s)
        self._due_s = 0.0
