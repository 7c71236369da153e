"""Preparation of a run: load a deployment, validate it with model, skin, faults and memory, freeze both."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from skinnet.body.simulation import BodySimulation
from skinnet.deployment import Deployment, load
from skinnet.deployment.checks import check
from skinnet.deployment.memory_loading import load_memory
from skinnet.errors import DeploymentError, MemoryFileError
from skinnet.network.faults.fault_schedule import check_targets
from skinnet.skin.placement import place_patches, resolve_bridges
from skinnet.skin.tactile_sheets import place_sheets
from skinnet.skin.whole_skin import join_patches, require_gateway_ports

__all__ = ["PreparedRun", "RunOptions", "prepare_run", "validate"]


@dataclass(frozen=True)
class RunOptions:
    """Run options of the command line.

    Attributes:
        deployment_file: Deployment file.
        settings: `key=value` settings.
        in_process: Run all processes in one.
        observer_endpoint: Observer endpoint; a free port on loopback unless given.
        plots: Draw plots and a picture.
        record: Write all recorded channels into a file of the run folder.
        on_observer_endpoint: Called with the observer endpoint once it is open.
    """

    deployment_file: Path
    settings: tuple[str, ...] = ()
    in_process: bool = False
    observer_endpoint: str | None = None
    plots: bool = True
    record: bool = False
    on_observer_endpoint: Callable[[str], None] | None = None

    @property
    def observable(self) -> bool:
        """True if the run has an observer endpoint: a run in one process only on demand."""
        return not (self.in_process and self.observer_endpoint is None and self.on_observer_endpoint is None)


@dataclass(frozen=True)
class PreparedRun:
    """Valid deployment with the base folder of its relative paths, and the options of the run.

    Attributes:
        options: Options of the run.
        deployment: The deployment.
        base: Folder of its relative paths.
        left_out: What of the model's file is left out or overridden, and why; one line each.
    """

    options: RunOptions
    deployment: Deployment
    base: Path
    left_out: tuple[str, ...] = ()


def prepare_run(options: RunOptions, seed: int | None = None) -> PreparedRun:
    """Load and validate the deployment of `options`, with `seed` in place of its own.

    Raises:
        DeploymentError: names file, key, value, what is allowed.
    """
    deployment = load(options.deployment_file, options.settings, seed)
    if deployment.cover:
        from skinnet.covering.covered_deployment import load_covered  # half a second of imports

        deployment = load_covered(options.deployment_file, options.settings, seed)
    left_out = validate(deployment, options.deployment_file)
    return PreparedRun(options, deployment, options.deployment_file.parent.resolve(), left_out)


def validate(deployment: Deployment, file: Path) -> tuple[str, ...]:
    """Validate a deployment across its keys, and with its MJCF model and its long-term memory.

    Return what of the model's file is left out or overridden, and why; one line each.

    Args:
        deployment: Deployment to validate.
        file: Its file, named in errors; relative paths start at its folder.

    Raises:
        DeploymentError: names file, key, value, what is allowed.
    """
    try:
        check(deployment)
        placed = place_patches(deployment.patches, deployment.cells, deployment.bridges)
        check_targets(deployment, placed)
        place_sheets(deployment.surfaces, deployment.sheets)
        if placed:
            skin = join_patches(placed, resolve_bridges(deployment.bridges, placed))
            require_gateway_ports(skin)
            if deployment.power is not None:
                skin.feed_cells(deployment.power.feeds)
        body = BodySimulation(deployment, file.parent)
        load_memory(deployment, file.parent, body.model.range_rad)
        return body.model.left_out
    except DeploymentError as error:
        raise DeploymentError(f"{file}: {error}") from None
    except MemoryFileError as error:
        raise DeploymentError(f"{file}: memory.read: {error}") from None
