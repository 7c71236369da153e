"""Command `skinnet preview`: a picture and a page of the skin on its robot, before any run."""

from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    SettingsOption,
    console,
    examples,
    line_printer,
)

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet preview deployments/two_link_arm.toml",
    "skinnet preview arm.toml --out previews --felt",
)


def register(app: typer.Typer) -> None:
    """Register the command `preview`."""
    app.command(epilog=_EXAMPLES)(preview)


def preview(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of picture and page, made if it is missing.")
    ] = Path(),
    felt: Annotated[
        bool,
        typer.Option(
            "--felt", help="Draws bodies as they are felt: collision geoms, meshes as their convex hulls."
        ),
    ] = False,
) -> None:
    """Draw the skin of a deployment at home: a picture (PNG) and a page (HTML) to turn and zoom.

    Bodies are grey; cells have normals, ports, wires and gateways. Cells that are buried, off the surface,
    overlapping, pressed at rest or without a gateway are red. The page needs no network, and has all findings
    that need no simulation.
    """
    from skinnet.covering.covered_deployment import load_covered
    from skinnet.diagnosis.diagnose import diagnose
    from skinnet.files import write_bytes
    from skinnet.preview.layers import preview_layers
    from skinnet.preview.page import render_page
    from skinnet.preview.picture import draw_picture

    say = line_printer(console())
    deployment = load_covered(file, tuple(settings or ()))
    base = file.parent.resolve()
    findings = diagnose(deployment, base).findings
    layers = preview_layers(deployment, base, findings, felt=felt)
    out.mkdir(parents=True, exist_ok=True)
    page, picture = (out / f"{deployment.name}_preview{suffix}" for suffix in (".html", ".png"))
    write_bytes(page, render_page(layers, deployment.name, findings).encode())
    say(f"page in {page}")
    reason = draw_picture(layers, deployment.name, picture)
    say(reason or f"picture in {picture}")
