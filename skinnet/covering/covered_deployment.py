"""Covers of a deployment made into patches, bridges and gateways, on the links of its model."""

import time
from pathlib import Path
from typing import Any

import msgspec

from skinnet.body.model import load_model
from skinnet.covering.cover_checks import check_covers
from skinnet.covering.covered_links import Covering, cover_links
from skinnet.covering.covering_cache import covering_key, read_covering, write_covering
from skinnet.covering.covering_gateways import GatewayPlan, with_gateways
from skinnet.covering.covering_metrics import network_metrics
from skinnet.covering.felt_solids import model_bytes
from skinnet.covering.measured_layouts import read_layout
from skinnet.deployment import Deployment, load
from skinnet.errors import DeploymentError

__all__ = ["cover_deployment", "covered", "load_covered", "with_covering"]

_DIGITS = 6
"""Digits of the home posture that count [rad, m]."""


def load_covered(path: Path, overrides: tuple[str, ...] = (), seed: int | None = None) -> Deployment:
    """Load a deployment as `load` does, and make its covers into patches.

    Raises:
        DeploymentError: as `load`, or a cover cannot be made; names the file.
    """
    deployment = load(path, overrides, seed)
    try:
        return covered(deployment, path.parent)
    except DeploymentError as error:
        raise DeploymentError(f"{path}: {error}") from None


def covered(deployment: Deployment, base_dir: Path) -> Deployment:
    """Return the deployment with patches, bridges and sheets for its covers; errors as `cover_deployment`."""
    if not deployment.cover:
        return deployment
    return with_covering(deployment, cover_deployment(deployment, base_dir))


def with_covering(deployment: Deployment, covering: Covering) -> Deployment:
    """Return the deployment with patches, bridges and sheets of its covering in place of its covers."""
    return msgspec.structs.replace(
        deployment,
        cover=(),
        patches=(*deployment.patches, *covering.patches),
        bridges=(*deployment.bridges, *covering.bridges),
        surfaces=(*deployment.surfaces, *covering.surfaces),
        sheets=(*deployment.sheets, *covering.sheets),
    )


def cover_deployment(deployment: Deployment, base_dir: Path, *, cached: bool = True) -> Covering:
    """Cover the links of the deployment's model as its covers ask.

    Coverings are kept in the user's cache folder, by the content of covers, cells, patches and model.

    Args:
        deployment: The deployment.
        base_dir: Folder that `body.model` is relative to.
        cached: Use and fill the cache.

    Raises:
        DeploymentError: a cover names no body, asks for no surface, its cells do not fit, its layout is
            wrong, or no number of gateways keeps the limits of `[plan]`.
        ModelError: there is no such model, or it cannot be read.
    """
    check_covers(deployment)
    model = load_model(deployment, base_dir, with_environment=False)
    mj, home_qpos = model.mj, model.home_qpos.round(_DIGITS)
    layouts = {
        cover.name: read_layout(base_dir / cover.layout, cover.name, of_sheets=cover.kind == "sheet")
        for cover in deployment.cover
        if cover.layout is not None
    }
    key = covering_key(deployment, model_bytes(mj), layouts, home_qpos.tolist())
    made = read_covering(key, Covering) if cached else None
    if made is None:
        start_s = time.process_time()
        made = cover_links(deployment, mj, layouts, home_qpos)
        made = msgspec.structs.replace(made, cpu_s=round(time.process_time() - start_s, 2))
        if cached:
            write_covering(key, made)
    none = GatewayPlan((), (), {}, {})
    plan = with_gateways(made.patches, made.bridges, deployment) if made.patches else none
    own = [[new for name in link["patches"] for new in plan.names[name]] for link in made.links]
    every = [patch.name for patch in plan.patches]
    *of_links, of_all = network_metrics([*own, every], plan.patches, plan.bridges, deployment.cells)
    links = tuple(
        _networked(link, names, plan, found)
        for link, names, found in zip(made.links, own, of_links, strict=True)
    )
    before, now = (sum(link["wires"] for link in rows) for rows in (made.links, links))
    total = _with_wires(made.total, before, now) | {"components": len(plan.patches)} | of_all
    return msgspec.structs.replace(made, patches=plan.patches, bridges=plan.bridges, links=links, total=total)


def _networked(
    link: dict[str, Any], patches: list[str], plan: GatewayPlan, network: dict[str, Any]
) -> dict[str, Any]:
    """Metrics of a link with those of its `network`, in which groups may be cut, so that it has `patches`."""
    n_wires = sum(plan.wires[name] for name in patches)
    row = _with_wires(link, link["wires"], n_wires)
    return row | {"patches": patches, "components": len(patches), "wires": n_wires} | network


def _with_wires(row: dict[str, Any], before: int, now: int) -> dict[str, Any]:
    """Metrics with the share of wires that is left of `before`."""
    return row if now == before else row | {"wired": round(row["wired"] * now / before, 4)}
