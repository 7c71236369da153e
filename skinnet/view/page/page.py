"""Web page of a run: viser server, panels and update loop."""

import contextlib
import html
import io
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import viser

from skinnet.body.visual_shapes import VisualModel
from skinnet.protocol.messages import Modality
from skinnet.view.page.body_view import BodyView
from skinnet.view.page.charts import Charts
from skinnet.view.page.colours import colour_indices
from skinnet.view.page.playback_controls import PlaybackControls
from skinnet.view.page.request_buttons import RequestButtons
from skinnet.view.panels import controller_states as machine
from skinnet.view.panels import event_raster as raster
from skinnet.view.panels import network_map as network
from skinnet.view.panels import patch_map as patches
from skinnet.view.panels import process_table as processes
from skinnet.view.sources.live_source import LiveSource
from skinnet.view.sources.recording_source import RecordingSource
from skinnet.view.sources.source import MessageSource
from skinnet.view.state.run_state import RunState
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["Page"]

_TICK_S = 1.0 / 30.0
_PANEL_PX, _CONTROLS_PX = 580, 300
_MODALITIES = {modality.name.lower(): modality for modality in Modality}
_Render = Callable[[], str]


class _Server(viser.ViserServer):
    """Viser server with public share URLs disabled."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse to share the page."""
        return None


@dataclass
class _PeriodicHtml:
    """HTML element rendered periodically, and sent if it has changed."""

    handle: viser.GuiHtmlHandle
    render: _Render
    period_s: float
    due_s: float = 0.0
    sent: str = ""


@dataclass
class RateMeter:
    """Event rates of the page over the last second, by name."""

    counts: dict[str, int] = field(default_factory=dict)
    since_s: float = 0.0
    rates: dict[str, float] = field(default_factory=dict)

    def count(self, name: str, n: int = 1) -> None:
        """Count `n` events of a name."""
        self.counts[name] = self.counts.get(name, 0) + n

    def update(self, now_s: float) -> None:
        """Turn the counts into rates, once a second."""
        passed_s = now_s - self.since_s
        if passed_s >= 1.0:
            self.rates = {name: n / passed_s for name, n in self.counts.items()}
            self.counts, self.since_s = dict.fromkeys(self.counts, 0), now_s


class Page:
    """Web page of one source, served on loopback behind an `AuthProxy`.

    Args:
        source: Message source, live or recorded.
        layout: Layout of the skin.
        body_model: Shapes of the body.
        show_requests: Show request buttons of the controller.
    """

    def __init__(
        self,
        source: MessageSource,
        layout: SkinLayout,
        body_model: VisualModel,
        *,
        show_requests: bool = False,
    ) -> None:
        self._source, self._layout = source, layout
        self._run_state = RunState(source.deployment, layout)
        self._stop = threading.Event()
        self._pending_actions: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self._modality = Modality.FORCE
        self._was_rendered: tuple[int, Modality] | None = None
        self.rates = RateMeter()
        with _suppress_stdout():
            self._server = _Server(
                host="127.0.0.1", port=0, label=f"skinnet · {source.deployment.name}", verbose=False
            )
        with self._server.atomic():
            self._server.gui.configure_theme(
                show_logo=False, show_share_button=False, brand_color=(37, 99, 168)
            )
            self._body_view = BodyView(self._server, body_model, layout, source.deployment)
            self._html_elements = [*self._add_main_panel(show_requests), *self._add_side_panel()]

    @property
    def port(self) -> int:
        """Port of the page's server, on loopback."""
        return int(self._server.get_port())

    def run(self, *, keep_open: bool) -> str:
        """Run the update loop until `stop` or, unless `keep_open`, the source ends; return why."""
        due_s = time.monotonic()
        while not self._stop.is_set():
            self._tick(time.monotonic())
            if self._source.end_reason and not keep_open:
                return self._source.end_reason
            due_s = max(due_s + _TICK_S, time.monotonic())
            self._stop.wait(due_s - time.monotonic())
        return "stopped"

    def stop(self) -> None:
        """Stop `run`; thread-safe."""
        self._stop.set()

    def close(self) -> None:
        """Stop the server."""
        with _suppress_stdout():
            self._server.stop()

    def _tick(self, now_s: float) -> None:
        while not self._pending_actions.empty():
            self._pending_actions.get()(now_s)
        self.rates.count("messages", self._source.deliver(self._run_state, now_s))
        watched = bool(self._server.get_clients())
        with self._server.atomic():
            if watched or self._was_rendered is None:
                self._update_body_view()
            for piece in self._html_elements:
                if now_s >= piece.due_s and (watched or not piece.sent):
                    piece.due_s = now_s + piece.period_s
                    content = piece.render()
                    if content != piece.sent:
                        piece.handle.content = piece.sent = content
            if self._charts.check_due(now_s):
                self._run_state.update_statistics()
                self._run_state.processes.update_rates(now_s)
                if watched:
                    self._charts.update(self._run_state.traffic.series())
            self._playback_controls.update(now_s)
            self._request_buttons.update(self._run_state)
        self.rates.update(now_s)

    def _update_body_view(self) -> None:
        scene = self._run_state
        self.rates.count(
            "body", bool(self._body_view.update_poses(scene.position_rad, scene.free_body_poses))
        )
        self._colour_index = colour_indices(
            self._modality,
            scene.skin.displayed_values(self._modality),
            self._layout.n_cells,
            scene.network.unreachable,
        )
        self.rates.count("cells", bool(self._body_view.update_colours(self._colour_index)))
        self._was_rendered = 0, self._modality

    def _add_main_panel(self, control: bool) -> Iterator[_PeriodicHtml]:
        gui = self._server.gui
        gui.main_panel.float(x=15, y=15, width=_CONTROLS_PX)
        yield _PeriodicHtml(gui.add_html(""), self._status, 0.2)
        choice = gui.add_dropdown("Colour by", tuple(_MODALITIES), initial_value="force")
        choice.on_update(
            lambda event: self._pending_actions.put(lambda _: self._select_modality(event.target.value))
        )
        yield _PeriodicHtml(
            gui.add_html(""), lambda: patches.render_legend(self._modality, self._layout), 0.5
        )
        source = self._source
        self._playback_controls = PlaybackControls(
            gui,
            self._server.get_event_loop().call_soon_threadsafe,
            source if isinstance(source, RecordingSource) else None,
            self._pending_actions.put,
        )
        self._request_buttons = RequestButtons(
            gui, source if control and isinstance(source, LiveSource) else None
        )

    def _add_side_panel(self) -> Iterator[_PeriodicHtml]:
        gui, atlas, scene = self._server.gui, self._layout, self._run_state
        panel = gui.add_panel()
        with panel.add_tab("Patches"):
            gui.add_html(patches.render(atlas))
            yield _PeriodicHtml(gui.add_html(""), lambda: patches.render_style(self._colour_index), 0.1)
            yield _PeriodicHtml(gui.add_html(""), lambda: patches.render_tooltips(atlas, scene), 0.5)
        with panel.add_tab("Network"):
            yield _PeriodicHtml(gui.add_html(""), lambda: network.render_legend(scene), 0.5)
            gui.add_html(network.render(atlas))
            yield _PeriodicHtml(gui.add_html(""), lambda: network.render_style(atlas, scene), 0.5)
            yield _PeriodicHtml(gui.add_html(""), lambda: network.render_tooltips(atlas, scene), 2.0)
        with panel.add_tab("Events"):
            gui.add_html(raster.render(atlas))
            yield _PeriodicHtml(gui.add_html(""), lambda: raster.render_style(atlas, scene), 0.25)
        with panel.add_tab("Charts"):
            self._charts = Charts(gui)
        with panel.add_tab("Controller"):
            yield _PeriodicHtml(gui.add_html(""), lambda: machine.render(scene.controller, scene.t_ns), 0.2)
        with panel.add_tab("Processes"):
            yield _PeriodicHtml(
                gui.add_html(""), lambda: processes.render(scene.processes, self._page_statistics()), 0.5
            )
        panel.dock_right()
        panel.set_width(_PANEL_PX)

    def _select_modality(self, name: str) -> None:
        self._modality = _MODALITIES[name]

    def _status(self) -> str:
        source, scene = self._source, self._run_state
        colour, word = ("#c92a2a", source.end_reason) if source.end_reason else ("#0b6e4f", source.title)
        state = f" · {scene.controller.state}" if scene.controller.state else ""
        return (
            '<div style="padding:6px 10px;font-size:13px;color:#1f2d3d">'
            f'<span style="color:{colour}">●</span> {html.escape(word)}'
            '<div class="sk-clock" style="font-size:20px;font-variant-numeric:tabular-nums">'
            f"{scene.t_ns * 1e-9:.2f} s"
            f'<span style="font-size:13px;color:#495766">{html.escape(state)}</span></div></div>'
        )

    def _page_statistics(self) -> dict[str, str]:
        scene = self._run_state
        rates = {f"{name} per second": f"{rate:.0f}" for name, rate in self.rates.rates.items()}
        own = {**self._source.properties(), "missed on the way": str(scene.n_missed), **rates}
        if scene.n_malformed:
            own |= {"made no sense": f"{scene.n_malformed}", "the last of them": scene.last_error}
        return own


@contextlib.contextmanager
def _suppress_stdout() -> Iterator[None]:
    """Suppress viser's announcements on standard output."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
