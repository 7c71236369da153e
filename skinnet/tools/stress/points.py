"""Points of a stress sweep, and the deployment of each."""

import math
from dataclasses import dataclass
from itertools import product

from msgspec.structs import replace

from skinnet.deployment import Deployment
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.checks import check
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.controller.stages import StageSpec
from skinnet.deployment.experiment.run import RunSpec
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.deployment.skin.cells import CellSpec, EncodingSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.errors import DeploymentError
from skinnet.network.faults.fault_schedule import check_targets
from skinnet.skin.gateway_placement import with_placed_gateways
from skinnet.skin.placement import place_patches

__all__ = ["LISTEN", "Point", "derive_deployment", "derive_points", "noise_sigma", "sweep_points"]

LISTEN = "listen"
"""Stage name: the only stage that a point's controller runs."""
_FORMATION_S = 10.0
"""Time limit of network formation [s, simulated]."""
_DEADLINE_S = 120.0
"""Deadline of a period end [s, wall]: several sweeps may share a computer, and a first run compiles."""


@dataclass(frozen=True)
class Point:
    """Sweep point: settings of one run; None stands for the deployment's own."""

    cells: int
    encoding: str
    gateways: int | None = None
    stimulated: float | None = None
    delta_sigma: float | None = None

    @property
    def name(self) -> str:
        """Name of the point's folder and prefix of its metrics."""
        words = [f"c{self.cells}", self.encoding]
        if self.delta_sigma is not None:
            words.append(f"k{self.delta_sigma:g}")
        if self.stimulated is not None:
            words.append(f"s{self.stimulated:g}")
        if self.gateways is not None:
            words.append(f"g{self.gateways}")
        return "-".join(words)


def sweep_points(deployment: Deployment, spec: StressSpec) -> list[Point]:
    """Points of the sweep `spec`, in the order in which they run, each once.

    Raises:
        DeploymentError: more cells than there are, or stimulated cells without a script.
    """
    total = sum(patch.n_cells for patch in deployment.patches)
    for cells in spec.cells:
        if cells > total:
            raise DeploymentError(f"stress.cells: {cells}; {deployment.name} has {total} cells, at most that")
    if deployment.scripted_stimuli is None and any(spec.stimulated_fractions):
        raise DeploymentError(
            "stress.stimulated_fractions: stimulated cells need [scripted_stimuli]; add it, or leave them out"
        )
    gateways = spec.gateways or (None,)
    stimulated = _stimulated(deployment, spec)
    counts = tuple(dict.fromkeys(_n_cells(deployment.patches, cells) for cells in spec.cells or (total,)))
    points = [
        Point(cells, encoding, ports, share)
        for cells, ports, share, encoding in product(counts, gateways, stimulated, spec.encodings)
    ]
    points += [
        Point(max(counts), "send_on_delta", gateways[0], share, sigma)
        for share, sigma in product(stimulated, spec.delta_noise_ratios)
    ]
    return list(dict.fromkeys(points))


def _stimulated(deployment: Deployment, spec: StressSpec) -> tuple[float | None, ...]:
    if deployment.scripted_stimuli is None:
        return (None,)
    return spec.stimulated_fractions or tuple(
        dict.fromkeys((0.0, deployment.scripted_stimuli.stimulated_fraction))
    )


def _first_patches(patches: tuple[PatchSpec, ...], cells: int) -> tuple[PatchSpec, ...]:
    """First patches that together have at least `cells` cells."""
    chosen: list[PatchSpec] = []
    for patch in patches:
        if sum(one.n_cells for one in chosen) >= cells:
            break
        chosen.append(patch)
    return tuple(chosen)


def _n_cells(patches: tuple[PatchSpec, ...], cells: int) -> int:
    return sum(patch.n_cells for patch in _first_patches(patches, cells))


def derive_points(deployment: Deployment, spec: StressSpec) -> list[tuple[Point, Deployment]]:
    """Points of the sweep `spec` in their order, each with its deployment.

    Raises:
        DeploymentError: the sweep has no such points, or a point is not a valid deployment.
    """
    return [(point, derive_deployment(deployment, point, spec)) for point in sweep_points(deployment, spec)]


def derive_deployment(deployment: Deployment, point: Point, spec: StressSpec) -> Deployment:
    """Derive the deployment of a point: its network forms, its controller listens, and it ends.

    Raises:
        DeploymentError: a patch has no room for that many gateways, or the settings are inconsistent.
    """
    cells = _with_encoding(deployment.cells, point)
    patches = _first_patches(deployment.patches, point.cells)
    script = deployment.scripted_stimuli
    if script is not None and point.stimulated is not None:
        script = replace(script, stimulated_fraction=point.stimulated)
    derived = replace(
        _restrict_to_patches(deployment, {patch.name for patch in patches}),
        run=_run_spec(deployment.run, spec),
        cells=cells,
        patches=tuple(_with_gateways(patch, cells, deployment, point.gateways) for patch in patches),
        scripted_stimuli=script,
        controller=_listening(deployment.controller, spec),
    )
    try:
        check(derived)
        check_targets(derived, place_patches(derived.patches, derived.cells))
    except DeploymentError as error:
        raise DeploymentError(f"point {point.name}: {error}") from None
    return derived


def _restrict_to_patches(deployment: Deployment, names: set[str]) -> Deployment:
    """Restrict `deployment` to the patches `names`; drop what belongs to others."""

    def there(place: str) -> bool:
        patch = place.split("/")[0].split(":")[0]
        return patch in names or patch not in all_names

    all_names = {patch.name for patch in deployment.patches}
    hosts = deployment.cell_processes
    if isinstance(hosts, dict):
        kept = {host: tuple(name for name in group if name in names) for host, group in hosts.items()}
        hosts = {host: group for host, group in kept.items() if group}
    power, script = deployment.power, deployment.scripted_stimuli
    if power is not None:
        power = replace(power, feeds=tuple(feed for feed in power.feeds if there(feed)))
    if script is not None:
        touches = (replace(t, cells=tuple(filter(there, t.cells))) for t in script.presses)
        script = replace(script, presses=tuple(touch for touch in touches if touch.cells))
    return replace(
        deployment,
        cell_processes=hosts,
        bridges=tuple(b for b in deployment.bridges if there(b.a) and there(b.b)),
        power=power,
        faults=tuple(rule for rule in deployment.faults if there(rule.target)),
        scripted_stimuli=script,
        teacher=replace(deployment.teacher, touches=(), lessons=(), strokes=()),
    )


def _run_spec(run: RunSpec, spec: StressSpec) -> RunSpec:
    max_s = _FORMATION_S + spec.warm_up_s + spec.duration_s
    return replace(run, max_s=max_s, pace="lockstep", deadline_s=_DEADLINE_S, tolerated_losses=())


def _listening(control: ControllerSpec, spec: StressSpec) -> ControllerSpec:
    stage = StageSpec(kind="passive", duration_s=spec.warm_up_s + spec.duration_s)
    return replace(control, program=(LISTEN,), stages={LISTEN: stage})


def _with_gateways(
    patch: PatchSpec, cells: CellSpec, deployment: Deployment, gateways: int | None
) -> PatchSpec:
    """Patch with `gateways` gateways; a patch reached only by bridges stays so."""
    if gateways is None or not patch.interfaces:
        return patch
    ends = [end for bridge in deployment.bridges for end in (bridge.a, bridge.b)]
    taken = [(cell, port) for name, cell, port in map(parse_port, ends) if name == patch.name]
    return with_placed_gateways(patch, cells, gateways, taken)


def noise_sigma(cells: CellSpec) -> dict[str, float]:
    """Noise σ of a reading at rest, by modality: standard deviation of sensor noise and quantisation."""
    sensors = {
        "force": (cells.force.noise, cells.force.lsb),
        "proximity": (cells.proximity.noise, cells.proximity.lsb),
        "acceleration": (cells.accelerometer.noise_g, cells.accelerometer.lsb_g),
        "temperature": (cells.temperature.noise_c, cells.temperature.lsb_c),
    }
    return {name: math.hypot(noise, lsb / math.sqrt(12.0)) for name, (noise, lsb) in sensors.items()}


def _with_encoding(cells: CellSpec, point: Point) -> CellSpec:
    cells = replace(cells, encoding=EncodingSpec(kind=point.encoding))  # type: ignore[arg-type]
    if point.delta_sigma is None:
        return cells
    delta = {name: point.delta_sigma * sigma for name, sigma in noise_sigma(cells).items()}
    return replace(
        cells,
        force=replace(cells.force, delta=delta["force"]),
        proximity=replace(cells.proximity, delta=delta["proximity"]),
        accelerometer=replace(cells.accelerometer, delta_g=delta["acceleration"]),
        temperature=replace(cells.temperature, delta_c=delta["temperature"]),
    )
