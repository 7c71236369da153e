"""A visitor's choice of a moment is kept, whatever the page itself writes to the slider."""

import asyncio
import contextlib
import inspect
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from skinnet.clock import NS_PER_S
from skinnet.view.page.playback_controls import PlaybackControls
from skinnet.view.sources.playback_clock import PlaybackClock


class Handle(SimpleNamespace):
    """An element of the page; `update` and `click` are called as its server does for a visitor."""

    def __init__(self, **properties: Any) -> None:
        super().__init__(callbacks=[], **properties)

    def on_update(self, callback: Callable[..., Any]) -> None:
        self.callbacks.append(callback)

    on_click = on_update

    async def update(self, value: float) -> None:
        """Change by a visitor: coroutines are awaited at once, functions get to a thread some time later."""
        self.value = value
        for callback in self.callbacks:
            event = SimpleNamespace(client=object(), target=self)
            if inspect.iscoroutinefunction(callback):
                await callback(event)
            else:
                asyncio.get_running_loop().call_later(0.01, callback, event)


class Gui(SimpleNamespace):
    def add_folder(self, name: str) -> Any:
        return contextlib.nullcontext()

    def add_slider(self, name: str, *, initial_value: float, **rest: float) -> Handle:
        self.slider = Handle(value=initial_value)
        return self.slider

    def add_button(self, label: str) -> Handle:
        return Handle(label=label)

    def add_dropdown(self, name: str, options: tuple[str, ...], initial_value: str) -> Handle:
        return Handle(value=initial_value)

    def add_checkbox(self, name: str, value: bool) -> Handle:
        return Handle(value=value)


async def test_a_change_is_not_lost_to_an_update_of_the_page() -> None:
    clock = PlaybackClock(0, 2 * NS_PER_S, 0.0)
    clock.seek(NS_PER_S, 0.0)
    clock.pause(0.0)
    gui, actions = Gui(), asyncio.Queue[Callable[[float], None]]()
    source: Any = SimpleNamespace(clock=clock)
    in_loop = asyncio.get_running_loop().call_soon_threadsafe
    controls = PlaybackControls(gui, in_loop, source, actions.put_nowait)  # type: ignore[arg-type]

    async with asyncio.timeout(5.0):
        await gui.slider.update(0.2)
        controls.update(0.0)  # still at 1 s, since nobody has called the action
        action = await actions.get()
    action(0.1)
    assert clock.position_ns(0.1) == NS_PER_S // 5

    controls.update(0.2)
    controls.update(1.0)
    await asyncio.sleep(0)
    assert gui.slider.value == 0.2
