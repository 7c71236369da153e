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

from skinnet.body.shapes import Figure
from skinnet.messages import Modality
from skinnet.view.atlas import Atlas
from skinnet.view.body_view import BodyView
from skinnet.view.charts import Charts
from skinnet.view.colours import shades
from skinnet.view.controls import Controls
from skinnet.view.live import LiveSource
from skinnet.view.panels import machine, network, patches, processes, raster
from skinnet.view.player import Player
from skinnet.view.recorded import RecordedSource
from skinnet.view.source import Source
from skinnet.view.state import Scene

__all__ = ["Page"]

_TICK_S = 1.0 / 30.0
_PANEL_PX, _CONTROLS_PX = 580, 300
_MODALITIES = {modality.name.lower(): modality for modality in Modality}
_LISTED = Callable[[], str]


class _Server(viser.ViserServer):
    """Viser server with public share URLs disabled."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse to share the page."""
        return None


@dataclass
class _Html:
    """HTML element rendered periodically, and sent if it has changed."""

    handle: viser.GuiHtmlHandle
    make: _LISTED
    every_s: float
    due_s: float = 0.0
    sent: str = ""


@dataclass
class Rates:
    """Event rates of the page over the last second, by name."""

    counts: dict[str, int] = field(default_factory=dict)
    since_s: float = 0.0
    last: dict[str, float] = field(default_factory=dict)

    def count(self, name: str, n: int = 1) -> None:
        """Count `n` events of a name."""
        self.counts[name] = self.counts.get(name, 0) + n

    def turn(self, now_s: float) -> None:
        """Turn the counts into rates, once a second."""
        passed_s = now_s - self.since_s
        if passed_s >= 1.0:
            self.last = {name: n / passed_s for name, n in self.counts.items()}
            self.counts, self.since_s = dict.fromkeys(self.counts, 0), now_s


class Page:
    """Web page of one source, served on loopback behind a `Gate`.

    Args:
        source: Message source, live or recorded.
        atlas: Layout of the skin.
        figure: Shapes of the body.
        control: Show request buttons of the controller.
    """

    def __init__(self, source: Source, atlas: Atlas, figure: Figure, *, control: bool = False) -> None:
        self._source, self._atlas = source, atlas
        self._scene = Scene(source.deployment, atlas)
        self._stop = threading.Event()
        self._wishes: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self._modality = Modality.FORCE
        self._painted: tuple[int, Modality] | None = None
        self.rates = Rates()
        with _quietly():
            self._server = _Server(
                host="127.0.0.1", port=0, label=f"skinnet · {source.deployment.name}", verbose=False
            )
        with self._server.atomic():
            self._server.gui.configure_theme(
                show_logo=False, show_share_button=False, brand_color=(37, 99, 168)
            )
            self._body = BodyView(self._server, figure, atlas, source.deployment)
            self._pieces = [*self._add_main(control), *self._add_panel()]

    @property
    def port(self) -> int:
        """Port of the page's server, on loopback."""
        return int(self._server.get_port())

    def run(self, *, keep: bool) -> str:
        """Run the update loop until `stop` or, unless `keep`, the end of the source; return the reason."""
        due_s = time.monotonic()
        while not self._stop.is_set():
            self._tick(time.monotonic())
            if self._source.over and not keep:
                return self._source.over
            due_s = max(due_s + _TICK_S, time.monotonic())
            self._stop.wait(due_s - time.monotonic())
        return "stopped"

    def stop(self) -> None:
        """Stop `run`; thread-safe."""
        self._stop.set()

    def close(self) -> None:
        """Stop the server."""
        with _quietly():
            self._server.stop()

    def _tick(self, now_s: float) -> None:
        while not self._wishes.empty():
            self._wishes.get()(now_s)
        self.rates.count("messages", self._source.feed(self._scene, now_s))
        watched = bool(self._server.get_clients())
        with self._server.atomic():
            if watched or self._painted is None:
                self._show_body()
            for piece in self._pieces:
                if now_s >= piece.due_s and (watched or not piece.sent):
                    piece.due_s = now_s + piece.every_s
                    content = piece.make()
                    if content != piece.sent:
                        piece.handle.content = piece.sent = content
            if self._charts.due(now_s):
                self._scene.digest()
                self._scene.machinery.measure(now_s)
                if watched:
                    self._charts.show(self._scene.trends.trend())
            self._player.show(now_s)
            self._controls.show(self._scene)
        self.rates.turn(now_s)

    def _show_body(self) -> None:
        scene = self._scene
        self.rates.count("body", bool(self._body.place(scene.position_rad, scene.world)))
        self._shade = shades(
            self._modality, scene.skin.values(self._modality), self._atlas.n_cells, scene.network.dead
        )
        self.rates.count("cells", bool(self._body.paint(self._shade)))
        self._painted = 0, self._modality

    def _add_main(self, control: bool) -> Iterator[_Html]:
        gui = self._server.gui
        gui.main_panel.float(x=15, y=15, width=_CONTROLS_PX)
        yield _Html(gui.add_html(""), self._status, 0.2)
        choice = gui.add_dropdown("Colour by", tuple(_MODALITIES), initial_value="force")
        choice.on_update(lambda event: self._wishes.put(lambda _: self._choose(event.target.value)))
        yield _Html(gui.add_html(""), lambda: patches.legend(self._modality, self._atlas), 0.5)
        source = self._source
        self._player = Player(gui, source if isinstance(source, RecordedSource) else None, self._wishes.put)
        self._controls = Controls(gui, source if control and isinstance(source, LiveSource) else None)

    def _add_panel(self) -> Iterator[_Html]:
        gui, atlas, scene = self._server.gui, self._atlas, self._scene
        panel = gui.add_panel()
        with panel.add_tab("Patches"):
            gui.add_html(patches.draw(atlas))
            yield _Html(gui.add_html(""), lambda: patches.paint(self._shade), 0.1)
            yield _Html(gui.add_html(""), lambda: patches.tell(atlas, scene), 0.5)
        with panel.add_tab("Network"):
            yield _Html(gui.add_html(""), lambda: network.legend(scene), 0.5)
            gui.add_html(network.draw(atlas))
            yield _Html(gui.add_html(""), lambda: network.paint(atlas, scene), 0.5)
            yield _Html(gui.add_html(""), lambda: network.tell(atlas, scene), 2.0)
        with panel.add_tab("Events"):
            gui.add_html(raster.draw(atlas))
            yield _Html(gui.add_html(""), lambda: raster.paint(atlas, scene), 0.25)
        with panel.add_tab("Charts"):
            self._charts = Charts(gui)
        with panel.add_tab("Controller"):
            yield _Html(gui.add_html(""), lambda: machine.draw(scene.mind, scene.t_ns), 0.2)
        with panel.add_tab("Processes"):
            yield _Html(gui.add_html(""), lambda: processes.draw(scene.machinery, self._own()), 0.5)
        panel.dock_right()
        panel.set_width(_PANEL_PX)

    def _choose(self, name: str) -> None:
        self._modality = _MODALITIES[name]

    def _status(self) -> str:
        source, scene = self._source, self._scene
        colour, word = ("#c92a2a", source.over) if source.over else ("#0b6e4f", source.title)
        state = f" · {scene.mind.state}" if scene.mind.state else ""
        return (
            '<div style="padding:6px 10px;font-size:13px;color:#1f2d3d">'
            f'<span style="color:{colour}">●</span> {html.escape(word)}'
            '<div class="sk-clock" style="font-size:20px;font-variant-numeric:tabular-nums">'
            f"{scene.t_ns * 1e-9:.2f} s"
            f'<span style="font-size:13px;color:#495766">{html.escape(state)}</span></div></div>'
        )

    def _own(self) -> dict[str, str]:
        scene = self._scene
        rates = {f"{name} a second": f"{rate:.0f}" for name, rate in self.rates.last.items()}
        own = {**self._source.facts(), "missed on the way": str(scene.missed), **rates}
        if scene.malformed:
            own |= {"made no sense": f"{scene.malformed}", "the last of them": scene.last_refusal}
        return own


@contextlib.contextmanager
def _quietly() -> Iterator[None]:
    """Suppress viser's announcements on standard output."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
