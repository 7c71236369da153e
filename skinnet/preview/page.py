"""Page of a preview: one HTML file with the viewer of the live page, the layers and a legend, offline."""

import contextlib
import html
import io
from collections.abc import Sequence

import numpy as np
import viser

from skinnet.diagnosis.finding import Finding
from skinnet.preview.layers import Layer
from skinnet.preview.picture import bounding_sphere_m, legend_labels
from skinnet.view.page.lights import add_lights

__all__ = ["render_page"]

_VIEW_DIRECTION = np.array([0.72, 0.55, 0.42])
_DISTANCE_RADII = 1.9
_STYLE = (
    "position:fixed;bottom:12px;left:12px;z-index:10;max-width:420px;max-height:calc(100vh - 40px);"
    "overflow:auto;padding:12px 16px;border-radius:8px;background:rgba(255,255,255,.92);"
    "box-shadow:0 1px 6px rgba(0,0,0,.25);"
    "font:13px/1.5 system-ui,sans-serif;color:#1f2d3d"
)
_SEVERITY_COLOURS = {"error": "#c92a2a", "warning": "#b35c00", "remark": "#495766"}


def render_page(layers: Sequence[Layer], title: str, findings: Sequence[Finding]) -> str:
    """Render a self-contained HTML page: the layers to turn and zoom, their legend, and all findings."""
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, label=title, verbose=False)
        try:
            _add_layers(server, layers)
            page = server.scene.as_html()
        finally:
            server.stop()
    start = page.rindex("</body>")
    return page[:start] + _legend(layers, title, findings) + page[start:]


def _add_layers(server: viser.ViserServer, layers: Sequence[Layer]) -> None:
    """Add lights and layers, and look at the bodies."""
    add_lights(server.scene)
    for layer in layers:
        server.scene.add_mesh_simple(
            f"/{layer.name}",
            layer.mesh.vertices_m.astype(np.float32),
            layer.mesh.faces.astype(np.uint32),
            color=layer.rgb,
            flat_shading=layer.is_skin,
            cast_shadow=False,
            receive_shadow=False,
        )
    centre_m, radius_m = bounding_sphere_m(layers)
    view = server.initial_camera
    position_m = np.array(centre_m) + _DISTANCE_RADII * radius_m * _VIEW_DIRECTION
    view.look_at, view.position = centre_m, tuple(position_m.tolist())


def _legend(layers: Sequence[Layer], title: str, findings: Sequence[Finding]) -> str:
    """Legend with the colours of the layers and, below, the findings."""
    rows = "".join(
        '<div><span style="display:inline-block;width:12px;height:12px;margin-right:8px;border-radius:2px;'
        f'background:rgb{layer.rgb};border:1px solid #999"></span>{html.escape(label)}</div>'
        for layer, label in zip(layers, legend_labels(layers), strict=True)
    )
    told = "".join(
        f'<p style="margin:6px 0"><b style="color:{_SEVERITY_COLOURS[finding.severity]}">'
        f"{finding.severity}</b> {html.escape(finding.subject)}: "
        f"{html.escape(finding.text)}<br>→ {html.escape(finding.mend)}</p>"
        for finding in findings
    )
    return (
        f'<details open id="legend" style="{_STYLE}"><summary style="font-size:15px">{html.escape(title)}'
        f"</summary>{rows}{told}</details>"
    )
